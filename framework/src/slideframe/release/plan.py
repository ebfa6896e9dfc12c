"""The area of the moving mass as seen from straight above."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.problem import Region

if TYPE_CHECKING:
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

Ring = Sequence[tuple[float, float]] | Float64Array


@dataclass(frozen=True)
class Plan:
    """Outlines of areas and of the holes in them, in the local frame.

    Attributes:
        rings: (corner, 2) each, m, without the first corner again at the end; outlines and holes in any order,
            since they don't cross: what an odd number of them surrounds belongs to the area.
    """

    rings: tuple[Float64Array, ...]

    @property
    def bounds(self) -> Float64Array:
        """South-western and north-eastern corner (2, 2), m."""
        corners = np.concatenate(self.rings)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @property
    def area(self) -> float:
        """Plan area, m2."""
        return float(self._geometry.area)

    def contains(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
        """Tell which points lie in the area."""
        import shapely

        inside: npt.NDArray[np.bool_] = shapely.contains_xy(self._geometry, x, y)
        return inside

    @cached_property
    def _geometry(self) -> "BaseGeometry":
        import shapely

        geometry: BaseGeometry = shapely.Polygon()
        for ring in self.rings:
            geometry = geometry.symmetric_difference(shapely.Polygon(ring))
        shapely.prepare(geometry)
        return geometry


def plan_of(region: Region) -> Plan:
    """Return the plan of a region in the local frame."""
    west, east, south, north = region.x_min, region.x_max, region.y_min, region.y_max
    return Plan((np.array([[west, south], [east, south], [east, north], [west, north]]),))


def fault_of(polygon: "Polygon") -> str | None:
    """Say what is wrong with a polygon, and where; None: nothing."""
    import shapely

    if polygon.is_empty or polygon.area == 0:
        return "encloses no area"
    if shapely.is_valid(polygon):
        return None
    reason = str(shapely.is_valid_reason(polygon))
    what, _, place = reason.partition("[")
    place = f" near ({', '.join(place.rstrip(']').split())})" if place else ""
    names = {
        "Self-intersection": "crosses itself",
        "Ring Self-intersection": "touches or crosses itself",
        "Hole lies outside shell": "has a hole outside its outline",
        "Holes are nested": "has a hole within a hole",
    }
    return names.get(what, what.lower()) + place
