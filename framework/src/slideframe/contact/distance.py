"""Signed distance from the nodes of a grid to a triangle mesh, near its surface only.

Nodes near the surface are found by the cells that hold it. Each one's nearest triangle then comes from trees of the
triangles' middles: the triangle with the nearest middle bounds the distance, and none whose disk lies beyond that can
be nearer.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.contact.mesh import BoolArray, IntArray, TriangleMesh
from slideframe.problem.grid import Grid

# Triangles longer than this many cells are searched piece by piece, since the disk around one says little of it.
LONGEST_PIECE = 1.5
# Pieces are searched in classes of size, each half as large as the one before; the last holds all smaller ones.
SIZE_CLASSES = 4
# Nodes that are looked at together: some hundred pairs of a node and a triangle each.
NODES_AT_ONCE = 40_000


@dataclass(frozen=True)
class NearNodes:
    """Nodes within reach of a surface.

    Attributes:
        nodes: (m, 3), their indices.
        distances: (m,), m; negative behind the surface.
        normals: (m, 3), unit vectors, the way to the front.
        at_border: (m,), whether the nearest point lies on the mesh's border, so that neither side can be told.
    """

    nodes: IntArray
    distances: Float64Array
    normals: Float64Array
    at_border: BoolArray


def near_nodes(mesh: TriangleMesh, grid: Grid, reach: float) -> NearNodes:
    """Return the nodes of `grid` within `reach` cells of the mesh, in the order of their indices."""
    corners = (mesh.corners - np.array(grid.origin)) / grid.spacing
    disks = Disks.around(corners, mesh.face_normals)
    nodes = _candidates(disks, np.array(grid.shape), reach)
    points = nodes.astype(np.float64)
    triangles, distances = _Search(points, corners, reach).nearest(disks)
    within = distances <= reach
    nodes, points, triangles = nodes[within], points[within], triangles[within]
    closest, feature = closest_points(points, corners[triangles])
    direction, border = _outward(mesh, triangles, feature)
    away = points - closest
    lengths = np.linalg.norm(away, axis=1)
    signs = np.where(_dot(away, direction) < 0, -1.0, 1.0)
    # on the surface itself the way out is the surface's normal
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    gradient = np.divide(signs[:, None] * away, lengths[:, None], out=direction.copy(), where=lengths[:, None] > 1e-6)
    return NearNodes(nodes, signs * lengths * grid.spacing, gradient, border)


@dataclass(frozen=True)
class Disks:
    """Disks that hold the pieces of triangles.

    Attributes:
        middles: (d, 3), in cells.
        radii: (d,), in cells.
        normals: (d, 3), unit vectors.
        triangles: (d,), whose piece each one is.
    """

    middles: Float64Array
    radii: Float64Array
    normals: Float64Array
    triangles: IntArray

    @classmethod
    def around(cls, corners: Float64Array, normals: Float64Array) -> "Disks":
        """Halve triangles (t, 3, 3) at their longest edge until none is long, and hold each piece by a disk."""
        triangles, done = np.arange(len(corners)), []
        while True:
            lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
            long = lengths.max(axis=1) > LONGEST_PIECE
            done.append((corners[~long], triangles[~long]))
            if not long.any():
                break
            corners, triangles, edge = corners[long], triangles[long], lengths[long].argmax(axis=1)
            row = np.arange(len(corners))
            a, b, c = (corners[row, (edge + shift) % 3] for shift in range(3))
            middle = (a + b) / 2
            corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
            triangles = np.concatenate([triangles, triangles])
        pieces, whose = (np.concatenate(parts) for parts in zip(*done, strict=True))
        middles = pieces.mean(axis=1)
        radii = np.linalg.norm(pieces - middles[:, None], axis=2).max(axis=1)
        return cls(middles, radii, normals[whose], whose)

    def by_size(self) -> list["Disks"]:
        """Return the classes of size."""
        halvings = np.floor(np.log2(self.radii.max(initial=0) / np.maximum(self.radii, np.finfo(np.float64).tiny)))
        sizes = np.minimum(halvings, SIZE_CLASSES - 1)
        return [self.only(np.flatnonzero(sizes == size)) for size in np.unique(sizes)]

    def only(self, which: IntArray) -> "Disks":
        """Return some of them."""
        return Disks(self.middles[which], self.radii[which], self.normals[which], self.triangles[which])

    def beyond(self, points: Float64Array, which: IntArray) -> Float64Array:
        """Return the distance in cells of points (p, 3) to one disk each, at most."""
        arms = points - self.middles[which]
        above = _dot(arms, self.normals[which]) ** 2
        beside = np.sqrt(np.maximum(_dot(arms, arms) - above, 0)) - self.radii[which]
        distance: Float64Array = np.sqrt(above + np.maximum(beside, 0) ** 2)
        return distance


def _candidates(disks: Disks, shape: IntArray, reach: float) -> IntArray:
    """Return all nodes (m, 3) that may be within reach, and some more, without doubles."""
    around = int(reach + disks.radii.max(initial=0) + 0.5)
    seeds = np.rint(disks.middles).astype(np.int64) + around
    padded = shape + 2 * around
    seeds = seeds[((seeds >= 0) & (seeds < padded)).all(axis=1)]
    # a border of the same width keeps a step along one axis from ending in the next row
    wide = padded + 2 * around
    flat = np.unique(np.ravel_multi_index(tuple(seeds.T + around), tuple(wide)))
    for stride in (wide[1] * wide[2], wide[2], 1):
        flat = np.unique(flat[:, None] + stride * np.arange(-around, around + 1))
    nodes = np.stack(np.unravel_index(flat, tuple(wide)), axis=1) - 2 * around
    return nodes[((nodes >= 0) & (nodes < shape)).all(axis=1)]


class _Search:
    """The nearest triangle of each point (n, 3) among corners (t, 3, 3), in cells, as far as it's within reach."""

    def __init__(self, points: Float64Array, corners: Float64Array, reach: float) -> None:
        self.points, self.corners, self.reach = points, corners, reach
        self.distances, self.triangles = np.full(len(points), np.inf), np.full(len(points), -1)

    def nearest(self, disks: Disks) -> tuple[IntArray, Float64Array]:
        """Return triangles (n,) and distances (n,) in cells; infinite where none is within reach."""
        from scipy.spatial import cKDTree

        farthest = self.reach + float(disks.radii.max(initial=0))
        distance, first = cKDTree(disks.middles).query(self.points, distance_upper_bound=farthest, workers=-1)
        near = np.flatnonzero(np.isfinite(distance))
        self._try(near, disks.triangles[first[near]])
        for size in disks.by_size():
            tree = cKDTree(size.middles)
            for part in np.array_split(near, max(1, len(near) // NODES_AT_ONCE)):
                bounds = np.minimum(self.distances[part], self.reach) + size.radii.max()
                found = tree.query_ball_point(self.points[part], bounds, workers=-1, return_sorted=False)
                counts = np.fromiter(map(len, found), np.int64, len(found))
                disk = np.fromiter(chain.from_iterable(found), np.int64, int(counts.sum()))
                point = np.repeat(part, counts)
                # forgives rounding: the nearest one itself must stay
                hopeful = size.beyond(self.points[point], disk) <= self.distances[point] + 1e-9
                self._try(point[hopeful], size.triangles[disk[hopeful]])
        return self.triangles, self.distances

    def _try(self, point: IntArray, triangle: IntArray) -> None:
        """Take triangles (m,) for points (m,) where they are nearer, of equals the first."""
        closest, _ = closest_points(self.points[point], self.corners[triangle])
        distance = np.linalg.norm(self.points[point] - closest, axis=1)
        order = np.lexsort((triangle, distance, point))
        point, triangle, distance = point[order], triangle[order], distance[order]
        first = np.ones(len(point), bool)
        first[1:] = point[1:] != point[:-1]
        point, triangle, distance = point[first], triangle[first], distance[first]
        known = self.distances[point]
        better = (distance < known) | ((distance == known) & (triangle < self.triangles[point]))
        self.distances[point[better]], self.triangles[point[better]] = distance[better], triangle[better]


def closest_points(points: Float64Array, corners: Float64Array) -> tuple[Float64Array, IntArray]:
    """Return the point of each triangle (p, 3, 3) nearest to each point (p, 3), and on which feature it lies.

    Features are 0 to 2 the corners, 3 to 5 the edges from corner k to the next, 6 the face (Ericson 2005, sect. 5.1.5).
    """
    a, b, c = (corners[:, corner] for corner in range(3))
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, points - a), _dot(ac, points - a)
    d3, d4 = _dot(ab, points - b), _dot(ac, points - b)
    d5, d6 = _dot(ab, points - c), _dot(ac, points - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    rules = [
        (d1 <= 0) & (d2 <= 0),
        (d3 >= 0) & (d4 <= d3),
        (d6 >= 0) & (d5 <= d6),
        (vc <= 0) & (d1 >= 0) & (d3 <= 0),
        (va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0),
        (vb <= 0) & (d2 >= 0) & (d6 <= 0),
    ]
    feature = np.select(rules, list(range(6)), 6)
    one, none = np.ones_like(d1), np.zeros_like(d1)
    along_ab, along_ac = _ratio(d1, d1 - d3), _ratio(d2, d2 - d6)
    along_bc, whole = _ratio(d4 - d3, (d4 - d3) + (d5 - d6)), va + vb + vc
    v = np.choose(feature, [none, one, none, along_ab, 1 - along_bc, none, _ratio(vb, whole)])
    w = np.choose(feature, [none, none, one, none, along_bc, along_ac, _ratio(vc, whole)])
    return a + v[:, None] * ab + w[:, None] * ac, feature


def _dot(a: Float64Array, b: Float64Array) -> Float64Array:
    product: Float64Array = np.einsum("pi,pi->p", a, b)
    return product


def _ratio(a: Float64Array, b: Float64Array) -> Float64Array:
    return np.divide(a, b, out=np.zeros_like(a), where=b != 0)


def _outward(mesh: TriangleMesh, triangle: IntArray, feature: IntArray) -> tuple[Float64Array, BoolArray]:
    """Return the direction (m, 3) to the front at features of triangles (m,), and whether they lie on the border."""
    direction = mesh.face_normals[triangle].copy()
    border = np.zeros(len(triangle), bool)
    for corner in range(3):
        here = feature == corner
        vertex = mesh.triangles[triangle[here], corner]
        direction[here], border[here] = mesh.vertex_normals[vertex], mesh.border_vertices[vertex]
        here = feature == 3 + corner
        direction[here] = mesh.edge_normals[triangle[here], corner]
        border[here] = mesh.border_edges[triangle[here], corner]
    return direction, border
