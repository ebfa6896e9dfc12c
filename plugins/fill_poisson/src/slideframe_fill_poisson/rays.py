"""Closed meshes ready for rays: what lies inside on vertical lines, and which points do."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, Int32Array

# Steeper faces than this sine of their slope against the vertical are walls, which no vertical line crosses.
LEAST_LEVELNESS = 1e-6
LINES_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Crossings:
    """Stretches of vertical lines inside a body, one row each, ordered by line and from the top down.

    Attributes:
        lines: index of the line (stretch,).
        tops: height where the line enters the body (stretch,), m.
        bottoms: height where it leaves it (stretch,), m.
    """

    lines: Int32Array
    tops: Float32Array
    bottoms: Float32Array


class Body:
    """A closed mesh, its triangles counter-clockwise seen from outside."""

    def __init__(self, vertices: Float32Array, triangles: Int32Array) -> None:
        """Build the tree that rays descend."""
        import open3d

        self.vertices, self.triangles = np.asarray(vertices, np.float32), triangles
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(tensor(self.vertices), tensor(triangles.astype(np.uint32)))
        corners = self.vertices[triangles].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        levelness = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
        self._upward = (levelness > LEAST_LEVELNESS).astype(np.int8) - (levelness < -LEAST_LEVELNESS)

    def stretches(self, x: Float64Array, y: Float64Array) -> Crossings:
        """Return what of the vertical lines at (x, y) is inside.

        Going down, a face that looks up leads into the body and one that looks down leads out of it, so that
        overhangs and hollows are right, and an edge hit twice counts once.
        """
        parts = []
        for first in range(0, len(x), LINES_AT_ONCE):
            part = self._stretches(x[first : first + LINES_AT_ONCE], y[first : first + LINES_AT_ONCE])
            parts.append((part.lines + np.int32(first), part.tops, part.bottoms))
        if not parts:
            return Crossings(np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32))
        lines, tops, bottoms = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return Crossings(lines, tops, bottoms)

    def _stretches(self, x: Float64Array, y: Float64Array) -> Crossings:
        lines, heights, entering = self._faces(x, y)
        same_line = lines[1:] == lines[:-1]
        changed = np.ones(len(lines), bool)
        changed[1:] = ~same_line | (entering[1:] != entering[:-1])
        changed &= ~(np.r_[True, ~same_line][: len(lines)] & ~entering)  # a line starts outside
        lines, heights, entering = lines[changed], heights[changed], entering[changed]
        leaves = np.r_[(lines[1:] == lines[:-1]) & ~entering[1:], False][: len(lines)]
        pairs = np.flatnonzero(entering & leaves)
        return Crossings(lines[pairs], heights[pairs], heights[np.minimum(pairs + 1, len(heights) - 1)])

    def inside(self, points: Float32Array) -> np.ndarray:
        """Tell which points lie in the body: the first face above looks up."""
        found = np.zeros(len(points), bool)
        for first in range(0, len(points), LINES_AT_ONCE):
            part = slice(first, first + LINES_AT_ONCE)
            up = np.tile(np.array([0, 0, 1], np.float32), (len(points[part]), 1))
            hits = self._scene.cast_rays(tensor(np.concatenate([points[part], up], axis=1)))
            met = np.isfinite(hits["t_hit"].numpy())
            triangle = np.where(met, hits["primitive_ids"].numpy(), 0)
            found[part] = met & (self._upward[triangle] > 0)
        return found

    def _faces(self, x: Float64Array, y: Float64Array) -> tuple[Int32Array, Float32Array, np.ndarray]:
        """Return line, height and whether it looks up of every face that the lines cross, top down."""
        start = float(self.vertices[:, 2].max()) + 1
        hits = self._scene.list_intersections(tensor(downward(x, y, start)))
        triangles = hits["primitive_ids"].numpy()
        level = np.flatnonzero(self._upward[triangles])
        lines, depths = hits["ray_ids"].numpy()[level].astype(np.int32), hits["t_hit"].numpy()[level]
        upward = self._upward[triangles[level]] > 0
        # faces that meet in one point are ordered too, so that the result doesn't hang on the tree
        order = np.lexsort((upward, depths, lines))
        return lines[order], np.float32(start) - depths[order], upward[order]


def downward(x: Float64Array, y: Float64Array, start: float) -> Float32Array:
    """Return rays straight down from height `start` at (x, y): (ray, 6) origin and direction."""
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 5] = x, y, start, -1
    return rays


def tensor(values: np.ndarray) -> Any:
    """Hand an array to Open3D, which wants it contiguous and its own."""
    import open3d

    return open3d.core.Tensor.from_numpy(np.array(values, order="C"))
