"""Closed bodies of triangles: the soil below the ground, the room over a slip surface, and what is cut from what.

Cuts are made by manifold3d, whose results are watertight: where the mass has been, terrain and slip surface share
their vertices.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array, Int32Array

# Faces keep the number of the body that they came from through every cut.
GROUND, SKIRT, PLAN, SLIP_SURFACE = range(4)
CLEARANCE = 10.0  # m that closed bodies reach beyond all that they are cut with


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside the body that they bound.

    Attributes:
        vertices: (vertex, 3), m.
        triangles: (triangle, 3), indices.
        origins: GROUND, SKIRT, PLAN or SLIP_SURFACE for each triangle (triangle,).
    """

    vertices: Float64Array
    triangles: Int32Array
    origins: Int32Array

    def only(self, chosen: np.ndarray) -> "Mesh":
        """Keep the chosen triangles and the vertices that they need."""
        used, renumbered = np.unique(self.triangles[chosen], return_inverse=True)
        return Mesh(self.vertices[used], renumbered.reshape(-1, 3).astype(np.int32), self.origins[chosen])


class Solid:
    """A body with a closed, oriented surface."""

    def __init__(self, manifold: Any, origin_of: dict[int, int]) -> None:
        """Wrap a Manifold whose faces' original ids are translated to origins by `origin_of`."""
        self._manifold, self._origin_of = manifold, origin_of

    @property
    def volume(self) -> float:
        """Enclosed volume, m3."""
        return float(self._manifold.volume())

    @property
    def is_empty(self) -> bool:
        """Whether nothing is enclosed."""
        return bool(self._manifold.is_empty())

    def common(self, other: "Solid") -> "Solid":
        """Return what lies in both."""
        return Solid(self._manifold ^ other._manifold, self._origin_of | other._origin_of)

    def without(self, other: "Solid") -> "Solid":
        """Return what lies in this body and not in the other."""
        return Solid(self._manifold - other._manifold, self._origin_of | other._origin_of)

    def united(self) -> "Solid":
        """Return the body with its separate parts united, should they overlap; hollow bodies stay as they are."""
        import manifold3d

        parts = self._manifold.decompose()
        if len(parts) < 2 or min(part.volume() for part in parts) < 0:
            return self
        return Solid(manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add), self._origin_of)

    def reaching(self, level: float) -> "Solid":
        """Return the parts that reach down to a height, m; hollows that they enclose are filled."""
        import manifold3d

        parts = [part for part in self._manifold.decompose() if part.bounding_box()[2] <= level]
        return Solid(manifold3d.Manifold.compose(parts), self._origin_of)

    def plan_area(self) -> float:
        """Return the area of the body's shadow from straight above, m2."""
        return float(self._manifold.project().area())

    def mesh(self) -> Mesh:
        """Return the surface."""
        found = self._manifold.to_mesh64()
        vertices = np.asarray(found.vert_properties, np.float64)[:, :3]
        joined = np.arange(len(vertices))
        joined[np.asarray(found.merge_from_vert, np.int64)] = np.asarray(found.merge_to_vert, np.int64)
        triangles = joined[np.asarray(found.tri_verts, np.int64)]
        lengths = np.diff(np.asarray(found.run_index, np.int64)) // 3
        origins = np.repeat([self._origin_of[int(number)] for number in found.run_original_id], lengths)
        whole = Mesh(vertices, triangles.astype(np.int32), origins.astype(np.int32))
        return whole.only(np.ones(len(triangles), bool))


def close_sheet(vertices: Float64Array, triangles: Int32Array, level: float, origin: int) -> Solid:
    """Close a sheet of triangles by vertical skirts from its rim to a flat lid at height `level`, m.

    With the sheet's triangles counter-clockwise seen from above, a level below all of it makes the body under
    the sheet; with clockwise ones, a level above makes the body over it.

    Raises:
        ValueError: the sheet has edges where more triangles meet from one side than from the other.
    """
    rim = rim_edges(triangles)
    ring = np.unique(rim)
    foot = np.full(len(vertices), -1)
    foot[ring] = len(vertices) + np.arange(len(ring))
    middle = len(vertices) + len(ring)
    start, end = rim.T
    skirt = np.concatenate(
        [
            np.column_stack([end, start, foot[start]]),
            np.column_stack([end, foot[start], foot[end]]),
            np.column_stack([foot[end], foot[start], np.full(len(rim), middle)]),
        ]
    )
    lid = np.column_stack([vertices[ring, :2], np.full(len(ring), level)])
    hub = [*(lid[:, :2].min(axis=0) + lid[:, :2].max(axis=0)) / 2, level]
    return closed_solid(
        np.concatenate([vertices, lid, [hub]]),
        [(triangles, origin), (skirt.astype(np.int32), SKIRT)],
    )


def closed_solid(vertices: Float64Array, parts: Sequence[tuple[Int32Array, int]]) -> Solid:
    """Make a body of parts of its surface, each with its origin.

    Raises:
        ValueError: the surface isn't closed, or its triangles don't agree on which side is outside.
    """
    import manifold3d

    first = manifold3d.Manifold.reserve_ids(len(parts))
    triangles = np.concatenate([part for part, _ in parts])
    counts = [0, *np.cumsum([3 * len(part) for part, _ in parts])]
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(vertices, np.float64),
        np.ascontiguousarray(triangles, np.uint64),
        run_index=np.array(counts, np.uint64),
        run_original_id=np.arange(first, first + len(parts), dtype=np.uint32),
    )
    manifold = manifold3d.Manifold(mesh)
    if manifold.status() != manifold3d.Error.NoError:
        raise ValueError(f"the triangles don't close a body: {manifold.status().name}")
    return Solid(manifold, {first + index: origin for index, (_, origin) in enumerate(parts)})


def upright_prism(rings: Sequence[Float64Array], low: float, high: float, origin: int) -> Solid:
    """Return the body over an outline between two heights, all its faces of one origin.

    Args:
        rings: outlines (corner, 2), m, of areas and of the holes in them; what an odd number of them surrounds is in.
        low: height of the bottom, m.
        high: height of the top, m.
        origin: of its faces.
    """
    import manifold3d

    outline = manifold3d.CrossSection([np.asarray(ring, np.float64) for ring in rings], manifold3d.FillRule.EvenOdd)
    body = outline.extrude(high - low).translate([0.0, 0.0, low]).as_original()
    return Solid(body, {body.original_id(): origin})


def rim_edges(triangles: Int32Array) -> Int32Array:
    """Return the directed edges (edge, 2) that only one triangle has."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    # one number for an edge, whichever way it runs: sorting numbers is ten times faster than sorting pairs
    _, first, counts = np.unique((low << 32) + high, return_index=True, return_counts=True)
    alone: Int32Array = edges[np.sort(first[counts == 1])]
    return alone


def height_field_sheet(x: Float64Array, y: Float64Array, heights: Float64Array) -> tuple[Float64Array, Int32Array]:
    """Return vertices and triangles, clockwise seen from above, of heights (column, row) at `x` by `y`, m."""
    across, along = np.meshgrid(x, y, indexing="ij")
    corner = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([a, c, b]), np.column_stack([a, d, c])])
    return np.column_stack([across.ravel(), along.ravel(), heights.ravel()]), triangles.astype(np.int32)
