"""What makes an outline unfit for a region."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Ring = Sequence[tuple[float, float]] | npt.NDArray[np.float64]

NAMES = {
    "Self-intersection": "crosses itself",
    "Ring Self-intersection": "touches itself",
    "Hole lies outside shell": "has a hole outside of it",
    "Holes are nested": "has a hole within a hole",
}


def fault_of(corners: Ring, holes: Sequence[Ring] = ()) -> str | None:
    """Say what is wrong with an outline and where; None: nothing.

    Args:
        corners: x and y of each corner; the first may stand again at the end.
        holes: the same of each hole.
    """
    import shapely

    rings = [[(float(x), float(y)) for x, y in ring] for ring in (corners, *holes)]
    for index, ring in enumerate(rings):
        if len(set(ring)) < 3:
            return f"{'has a hole that ' if index else ''}encloses nothing: it has {len(set(ring))} different corners"
    polygon = shapely.Polygon(rings[0], rings[1:])
    if shapely.is_valid(polygon):
        return None if polygon.area > 0 else "encloses nothing"
    if shapely.Polygon(rings[0]).convex_hull.area == 0:
        return "encloses nothing: its corners lie on one line"
    what, _, place = str(shapely.is_valid_reason(polygon)).partition("[")
    near = f" near ({', '.join(place.rstrip(']').split())})" if place else ""
    return NAMES.get(what, what.lower()) + near
