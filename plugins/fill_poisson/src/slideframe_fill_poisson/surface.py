"""The ground's surface: a screened Poisson mesh, and how well splats support it."""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, Int32Array, UInt8Array
from slideframe_fill_poisson.rays import downward, tensor
from slideframe_fill_poisson.solids import GROUND, Mesh, rim_edges
from slideframe_fill_poisson.support import Support, distance_to

OBSERVED, INTERPOLATED, EXTRAPOLATED = 0, 1, 2
DEEPEST_OCTREE = 11
# The octree's cube is wider than the splats by this factor, so that the sheet ends beyond all of them.
CUBE_SCALE = 1.1
# The solver sums over threads in the order in which they finish; one thread gives the same bits every time.
POISSON_THREADS = 1
POINTS_AT_ONCE = 2_000_000
BLOCK_SPACINGS = 3.0  # side of the blocks of deep points that share their nearest point of the surface
DEEP = 6.0  # half diagonals of a block


class Surface:
    """The ground as triangles with normals to the air, ready for rays.

    Attributes:
        vertices: (vertex, 3), m.
        triangles: (triangle, 3), counter-clockwise seen from the air.
    """

    def __init__(self, vertices: Float32Array, triangles: Int32Array) -> None:
        """Build the tree that rays descend."""
        import open3d

        self.vertices, self.triangles = np.asarray(vertices, np.float32), triangles
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(tensor(self.vertices), tensor(triangles.astype(np.uint32)))

    def nearest(self, points: Float32Array) -> tuple[Float32Array, Int32Array]:
        """Return the nearest point on the surface of each point (point, 3), m, and the vertex nearest to that."""
        foot, vertex = np.empty((len(points), 3), np.float32), np.empty(len(points), np.int32)
        for first in range(0, len(points), POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            found = self._scene.compute_closest_points(tensor(points[part]))
            foot[part] = found["points"].numpy()
            along = found["primitive_uvs"].numpy()
            shares = np.column_stack([1 - along.sum(axis=1), along])
            corner = self.triangles[found["primitive_ids"].numpy()]
            vertex[part] = np.take_along_axis(corner, shares.argmax(axis=1)[:, None], axis=1)[:, 0]
        return foot, vertex

    def nearest_of_many(self, points: Float32Array, spacing: float) -> tuple[Float32Array, Int32Array]:
        """Return what `nearest` does, for points that fill a volume and lie about `spacing` metres apart.

        Deep points of a block share the nearest point of the block's middle: where that is DEEP half diagonals
        away, the distance is too long by 1 / (2 DEEP^2) at most, 1.4 %.
        """
        foot, vertex = np.empty((len(points), 3), np.float32), np.empty(len(points), np.int32)
        side = BLOCK_SPACINGS * spacing
        low = points.min(axis=0)
        place = ((points - low) / side).astype(np.int64)
        keys, block = np.unique((place[:, 0] << 42) + (place[:, 1] << 21) + place[:, 2], return_inverse=True)
        index = np.stack([keys >> 42, (keys >> 21) & (2**21 - 1), keys & (2**21 - 1)], axis=1)
        middle = (low + side * (index + 0.5)).astype(np.float32)
        block_foot, block_vertex = self.nearest(middle)
        deep = np.linalg.norm(block_foot - middle, axis=1) > DEEP * side * np.sqrt(3) / 2
        shared = deep[block]
        foot[shared], vertex[shared] = block_foot[block[shared]], block_vertex[block[shared]]
        foot[~shared], vertex[~shared] = self.nearest(points[~shared])
        return foot, vertex

    def top(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the height of the highest face at (x, y), or minus infinity where there is none, m."""
        start = float(self.vertices[:, 2].max()) + 1
        hits = self._scene.cast_rays(tensor(downward(x, y, start)))["t_hit"].numpy()
        return start - hits.astype(np.float64)


def poisson_sheet(support: Support) -> tuple[Float64Array, Int32Array]:
    """Mesh the ground (Kazhdan & Hoppe 2013) with cells as wide as the splats' spacing.

    The sheet ends at the sides of a cube about the splats. Closed parts are left out: they float in the air, as the
    crowns of trees do, or are bubbles in the soil, as under a bush; no camera sees into a void that is closed.

    Returns:
        Vertices (vertex, 3), m, and triangles (triangle, 3), counter-clockwise seen from the air.
    """
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(support.centers))
    cloud.normals = open3d.utility.Vector3dVector(support.normals)
    widest = CUBE_SCALE * float(np.ptp(support.centers, axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(widest / support.spacing)), 4, DEEPEST_OCTREE))
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=CUBE_SCALE, linear_fit=True, n_threads=POISSON_THREADS
    )
    vertices, triangles = np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).astype(np.int32)
    return vertices, _open_parts(triangles, len(vertices))


def support_classes(vertices: Float64Array, support: Support, observed: float, extrapolated: float) -> UInt8Array:
    """Return OBSERVED, INTERPOLATED or EXTRAPOLATED for each vertex.

    Args:
        vertices: (vertex, 3), m.
        support: the splats that the surface rests on.
        observed: distance to the nearest splat up to which a vertex counts as observed, m.
        extrapolated: distance beyond which it counts as extrapolated, m.
    """
    distances = distance_to(support.centers, vertices)
    return np.digitize(distances, [observed, extrapolated], right=True).astype(np.uint8)


def unsupported_rim(mesh: Mesh, classes: UInt8Array) -> np.ndarray:
    """Tell which triangles of the ground are extrapolated and reach the mesh's rim through such ones (triangle,).

    There the scan ended and Poisson went on inventing; what is extrapolated within the scan closes a gap. Slip surface
    and sides of a pit aren't ground: no splat stands near them, and they stay.
    """
    doubtful = np.flatnonzero((mesh.origins == GROUND) & (classes[mesh.triangles] == EXTRAPOLATED).all(axis=1))
    corners = mesh.triangles[doubtful]
    part_of = _parts(corners, len(mesh.vertices))
    at_rim = np.zeros(len(mesh.vertices), bool)
    at_rim[part_of[np.unique(rim_edges(mesh.triangles))]] = True
    found = np.zeros(len(mesh.triangles), bool)
    found[doubtful[at_rim[part_of[corners[:, 0]]]]] = True
    return found


def _open_parts(triangles: Int32Array, count: int) -> Int32Array:
    """Return the triangles of the parts, of `count` vertices, that reach the rim."""
    part_of = _parts(triangles, count)
    kept = np.zeros(count, bool)
    kept[part_of[np.unique(rim_edges(triangles))]] = True
    chosen: Int32Array = triangles[kept[part_of[triangles[:, 0]]]]
    return chosen


def _parts(triangles: Int32Array, count: int) -> Int32Array:
    """Return which connected part each of `count` vertices is of (vertex,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    edges = coo_matrix((np.ones(len(rows), bool), (rows, columns)), (count, count))
    parts: Int32Array = connected_components(edges, directed=False)[1]
    return parts
