"""The ground's surface: a screened Poisson mesh, what supports it, and what lies below it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, Int32Array, UInt8Array
from slideframe_fill_poisson.support import Support

OBSERVED, INTERPOLATED, EXTRAPOLATED = 0, 1, 2
DEEPEST_OCTREE = 11
# The solver sums over threads in the order in which they finish; one thread gives the same bits every time.
POISSON_THREADS = 1


@dataclass(frozen=True)
class Crossings:
    """Stretches of soil on vertical lines, one row each, ordered by line and from the top down.

    Attributes:
        lines: index of the line (stretch,).
        tops: height where the line enters the soil (stretch,), m.
        bottoms: height where it leaves the soil, or the base (stretch,), m.
    """

    lines: Int32Array
    tops: Float32Array
    bottoms: Float32Array


class Surface:
    """A triangle mesh with normals out of the ground, ready for rays.

    Attributes:
        vertices: (vertex, 3), m.
        triangles: (triangle, 3), counter-clockwise seen from the air.
        support: OBSERVED, INTERPOLATED or EXTRAPOLATED for each vertex.
    """

    def __init__(self, vertices: Float32Array, triangles: Int32Array, support: UInt8Array) -> None:
        """Build the tree that rays descend."""
        import open3d

        self.vertices, self.triangles, self.support = vertices, triangles, support
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(_tensor(vertices), _tensor(triangles.astype(np.uint32)))
        corners = vertices[triangles]
        self._upward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0

    def nearest(self, points: Float32Array) -> Float32Array:
        """Return the nearest point on the surface of each point (point, 3), m."""
        found: Float32Array = self._scene.compute_closest_points(_tensor(points))["points"].numpy()
        return found

    def soil(self, x: Float64Array, y: Float64Array, base: float) -> Crossings:
        """Return the stretches of soil above `base` on vertical lines at (x, y).

        Going down, a face that looks up leads into the soil and one that looks down leads out of it, so that
        overhangs are right, an edge hit twice counts once, and the last soil reaches the base.
        """
        lines, heights, entering = self._faces(x, y)
        changed = np.ones(len(lines), bool)
        same_line = lines[1:] == lines[:-1]
        changed[1:] = ~same_line | (entering[1:] != entering[:-1])
        first = np.r_[True, ~same_line][: len(lines)]
        changed &= ~(first & ~entering)  # a line starts in the air, so it can't leave the soil first
        lines, heights, entering = lines[changed], heights[changed], entering[changed]
        leaves = np.r_[(lines[1:] == lines[:-1]) & ~entering[1:], False][: len(lines)]
        bottoms = np.where(leaves, np.r_[heights[1:], base][: len(heights)], base)
        kept = entering & (heights > base)
        return Crossings(lines[kept], heights[kept], np.maximum(bottoms[kept], base).astype(np.float32))

    def top(self, x: Float64Array, y: Float64Array) -> Float32Array:
        """Return the height of the highest face at (x, y), or minus infinity where there is none, m."""
        start = float(self.vertices[:, 2].max()) + 1
        hits = self._scene.cast_rays(_tensor(_downward(x, y, start)))["t_hit"].numpy()
        heights: Float32Array = np.float32(start) - hits
        return heights

    def inside(self, points: Float32Array) -> np.ndarray:
        """Tell which points lie in the soil: the face above looks up, and there is one."""
        rays = np.concatenate([points, np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))], axis=1)
        hits = self._scene.cast_rays(_tensor(rays))
        found = np.isfinite(hits["t_hit"].numpy())
        triangle = np.where(found, hits["primitive_ids"].numpy(), 0)
        above: np.ndarray = found & self._upward[triangle]
        return above

    def _faces(self, x: Float64Array, y: Float64Array) -> tuple[Int32Array, Float32Array, np.ndarray]:
        """Return line, height and whether it looks up of every face that the lines cross, top down."""
        start = float(self.vertices[:, 2].max()) + 1
        hits = self._scene.list_intersections(_tensor(_downward(x, y, start)))
        lines, depths = hits["ray_ids"].numpy().astype(np.int32), hits["t_hit"].numpy()
        upward = self._upward[hits["primitive_ids"].numpy()]
        # faces that meet in one point are ordered too, so that the result doesn't hang on the tree
        order = np.lexsort((upward, depths, lines))
        return lines[order], np.float32(start) - depths[order], upward[order]


def poisson_surface(support: Support, observed: float, extrapolated: float) -> Surface:
    """Mesh the ground (Kazhdan & Hoppe 2013) with cells as wide as the splats' spacing.

    Args:
        support: the splats it rests on.
        observed: distance to the nearest splat up to which a vertex counts as observed, m.
        extrapolated: distance beyond which it counts as extrapolated, m.
    """
    import open3d
    from scipy.spatial import cKDTree

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(support.centers))
    cloud.normals = open3d.utility.Vector3dVector(support.normals)
    scale = 1.1
    widest = scale * float(np.ptp(support.centers, axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(widest / support.spacing)), 4, DEEPEST_OCTREE))
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=scale, linear_fit=True, n_threads=POISSON_THREADS
    )
    vertices = np.asarray(mesh.vertices)
    distances, _ = cKDTree(support.centers).query(vertices)
    classes = np.digitize(distances, [observed, extrapolated], right=True).astype(np.uint8)
    kept = _supported_parts(mesh, classes)
    return _compact(vertices.astype(np.float32), kept, classes)


def cut_out(surface: Surface, inside: np.ndarray) -> Surface:
    """Keep the triangles that have a corner among the chosen vertices."""
    return _compact(surface.vertices, surface.triangles[inside[surface.triangles].any(axis=1)], surface.support)


def _supported_parts(mesh: Any, classes: UInt8Array) -> Int32Array:
    """Return the triangles of connected parts that a splat supports: Poisson closes voids with bubbles."""
    part_of, _, _ = mesh.cluster_connected_triangles()
    part_of, triangles = np.asarray(part_of), np.asarray(mesh.triangles).astype(np.int32)
    observed = np.zeros(part_of.max(initial=-1) + 1, bool)
    observed[part_of[(classes[triangles] == OBSERVED).any(axis=1)]] = True
    kept: Int32Array = triangles[observed[part_of]]
    return kept


def _compact(vertices: Float32Array, triangles: Int32Array, classes: UInt8Array) -> Surface:
    used, renumbered = np.unique(triangles, return_inverse=True)
    return Surface(vertices[used], renumbered.reshape(-1, 3).astype(np.int32), classes[used])


def _downward(x: Float64Array, y: Float64Array, start: float) -> Float32Array:
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 5] = x, y, start, -1
    return rays


def _tensor(values: np.ndarray) -> Any:
    import open3d

    return open3d.core.Tensor.from_numpy(np.array(values, order="C"))
