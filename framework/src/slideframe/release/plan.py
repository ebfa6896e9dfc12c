"""The area of the moving mass as seen from straight above."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array
from slideframe.errors import ConfigurationError, SlideframeError
from slideframe.formats.meshes import read_mesh
from slideframe.formats.outlines import read_outlines
from slideframe.problem import BoxRegion, MeshRegion, PolygonRegion, Region
from slideframe.problem.outline import fault_of
from slideframe.products import Georeference
from slideframe.release.coordinates import local_outline, local_points

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


@dataclass(frozen=True)
class Plan:
    """Outlines of areas and of the holes in them, in the local frame.

    Attributes:
        rings: (corner, 2) each, m; outlines and holes in any order, since they don't cross: what an odd
            number of them surrounds belongs to the area.
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

    def distance_to_outline(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return how far points are from the nearest outline (point,), m."""
        import shapely

        distances: Float64Array = shapely.distance(self._geometry.boundary, shapely.points(x, y))
        return distances

    @cached_property
    def _geometry(self) -> "BaseGeometry":
        import shapely

        geometry: BaseGeometry = shapely.Polygon()
        for ring in self.rings:
            geometry = geometry.symmetric_difference(shapely.Polygon(ring))
        shapely.prepare(geometry)
        return geometry


def plan_of(region: Region, georeference: Georeference) -> Plan:
    """Return the plan of a region in the local frame.

    Raises:
        ConfigurationError: an outline is unsound, or its coordinates can't be what they are said to be.
        InputError, MissingDependency: a file can't be read.
    """
    if isinstance(region, BoxRegion):
        west, east, south, north = region.x_min, region.x_max, region.y_min, region.y_max
        return Plan((np.array([[west, south], [east, south], [east, north], [west, north]]),))
    if isinstance(region, MeshRegion):
        return _shadow(region, georeference)
    return _outlined(region, georeference)


def swapped_plan(region: Region, georeference: Georeference, points: Float32Array) -> bool:
    """Tell whether a region with x and y exchanged would hold one of the points (point, 3)."""
    try:
        if isinstance(region, PolygonRegion):
            plan = _outlined(region, georeference, order=-1)
        else:
            plan = Plan(tuple(ring[:, ::-1] for ring in plan_of(region, georeference).rings))
    except SlideframeError:
        return False
    return bool(plan.contains(points[:, 0], points[:, 1]).any())


def _outlined(region: PolygonRegion, georeference: Georeference, order: int = 1) -> Plan:
    if region.path is None:
        where, epsg = "[region] corners", region.epsg
        polygons = [tuple(np.asarray(ring, np.float64) for ring in (region.corners, *region.holes))]
    else:
        polygons, found = read_outlines(region.path, region.layer)
        where, epsg = str(region.path), found if region.epsg is None else region.epsg
    for polygon in polygons:
        if fault := fault_of(polygon[0], polygon[1:]):
            raise ConfigurationError(f"the outline {fault}", where=where, cure="mend it where it was drawn")
    if len(polygons) > 1:
        polygons = _joined(polygons)
    rings = [ring[:, ::order] for polygon in polygons for ring in polygon]
    return Plan(tuple(local_outline(ring, epsg, georeference, where) for ring in rings))


def _joined(polygons: list[tuple[Float64Array, ...]]) -> list[tuple[Float64Array, ...]]:
    """Unite polygons, which may overlap."""
    import shapely

    whole = shapely.union_all([shapely.Polygon(polygon[0], polygon[1:]) for polygon in polygons])
    return [
        tuple(shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors))
        for part in shapely.get_parts(whole)
    ]


def _shadow(region: MeshRegion, georeference: Georeference) -> Plan:
    """Return the area under a mesh."""
    import shapely

    vertices, triangles = read_mesh(region.path)
    corners = local_points(vertices, region, georeference, str(region.path))[triangles][:, :, :2]
    (ab, ac) = (corners[:, 1] - corners[:, 0]), (corners[:, 2] - corners[:, 0])
    facing_up = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] > 0
    if not facing_up.any():
        raise ConfigurationError(
            "the mesh encloses nothing: no triangle looks up", where=str(region.path), cure="give a closed mesh"
        )
    whole = shapely.union_all(shapely.polygons(corners[facing_up]))
    return Plan(
        tuple(
            shapely.get_coordinates(ring)[:-1]
            for part in shapely.get_parts(whole)
            for ring in (part.exterior, *part.interiors)
        )
    )
