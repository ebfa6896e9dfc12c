"""A triangle mesh with the normals that tell its two sides apart at faces, edges and vertices."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Vertices nearer to one another than this share of the mesh's size are one: meshes are often written face by face.
WELD_TOLERANCE = 1e-7
# What lies this near to a side of the mesh's box, in shares of the mesh's size, lies in it.
SIDE_TOLERANCE = 1e-6
# Edge k runs from corner EDGES[k][0] to EDGES[k][1].
EDGES = ((0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class TriangleMesh:
    """Welded vertices (v, 3), m, and triangles (t, 3), counter-clockwise seen from outside, none without area."""

    vertices: Float64Array
    triangles: IntArray

    @classmethod
    def welded(cls, vertices: npt.NDArray[np.floating], triangles: npt.NDArray[np.integer]) -> "TriangleMesh":
        """Return a mesh whose triangles share vertices where they touch."""
        points = vertices.astype(np.float64)
        cell = max(float(np.ptp(points, axis=0).max()) * WELD_TOLERANCE, np.finfo(np.float64).tiny)
        _, first, which = np.unique(np.round(points / cell), axis=0, return_index=True, return_inverse=True)
        points, corners = points[first], which.ravel()[triangles]
        areas = np.linalg.norm(_cross_of(points, corners), axis=1)
        return cls(points, corners[areas > 1e-12 * max(float(areas.max()), np.finfo(np.float64).tiny)])

    @cached_property
    def corners(self) -> Float64Array:
        """Corners (t, 3, 3), m."""
        return self.vertices[self.triangles]

    @cached_property
    def face_normals(self) -> Float64Array:
        """Unit normals (t, 3)."""
        normals = _cross_of(self.vertices, self.triangles)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals

    @cached_property
    def areas(self) -> Float64Array:
        """Areas (t,), m2."""
        doubled: Float64Array = np.linalg.norm(_cross_of(self.vertices, self.triangles), axis=1)
        return doubled / 2

    @cached_property
    def vertex_normals(self) -> Float64Array:
        """Sums (v, 3) of face normals by the angle at the vertex (Baerentzen and Aanaes 2005): their sign is right."""
        sums = np.zeros_like(self.vertices)
        for corner in range(3):
            here, after, before = (self.corners[:, (corner + shift) % 3] for shift in range(3))
            one, other = after - here, before - here
            cosine = np.einsum("ti,ti->t", one, other) / (np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1))
            angle = np.arccos(np.clip(cosine, -1, 1))
            np.add.at(sums, self.triangles[:, corner], angle[:, None] * self.face_normals)
        return sums

    @cached_property
    def _edges(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the unique edges (e, 2), for each triangle its three edges (t, 3), and each edge's triangles (e,)."""
        ends = np.concatenate([np.sort(self.triangles[:, list(edge)], axis=1) for edge in EDGES])
        unique, which, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        return unique, which.reshape(3, -1).T, counts

    @cached_property
    def edge_normals(self) -> Float64Array:
        """Sums (t, 3, 3) of the normals of the faces at each of a triangle's three edges."""
        unique, edges, _ = self._edges
        sums = np.zeros((len(unique), 3))
        for edge in range(3):
            np.add.at(sums, edges[:, edge], self.face_normals)
        return sums[edges]

    @cached_property
    def border_edges(self) -> BoolArray:
        """Whether each of a triangle's three edges (t, 3) belongs to no other triangle."""
        _, edges, counts = self._edges
        alone: BoolArray = counts[edges] == 1
        return alone

    @cached_property
    def border_vertices(self) -> BoolArray:
        """Whether each vertex (v,) lies on the border."""
        flags = np.zeros(len(self.vertices), bool)
        unique, _, counts = self._edges
        flags[unique[counts == 1].ravel()] = True
        return flags

    @cached_property
    def shells(self) -> IntArray:
        """Return for each vertex (v,) a number that it shares with those that triangles connect it with."""
        return _connected(self._edges[0], len(self.vertices))

    @cached_property
    def _border_loops(self) -> list[list[Float64Array]]:
        """Return for each open shell the lowest and highest corner (2, 3), m, of its border's loops, widest first."""
        unique, _, counts = self._edges
        if not (counts == 1).any():
            return []
        loops = _connected(unique[counts == 1], len(self.vertices))
        boxes: dict[int, list[Float64Array]] = {}
        for loop in np.unique(loops[self.border_vertices]):
            members = self.border_vertices & (loops == loop)
            points = self.vertices[members]
            boxes.setdefault(int(self.shells[np.argmax(members)]), []).append(np.array([points.min(0), points.max(0)]))
        return [sorted(shell, key=lambda box: -float(np.linalg.norm(box[1] - box[0]))) for shell in boxes.values()]

    def gaps(self) -> list[Float64Array]:
        """Return the lowest and highest corner (2, 3), m, of every loop of the border."""
        return [box for shell in self._border_loops for box in shell]

    def holes(self) -> list[Float64Array]:
        """Return the lowest and highest corner (2, 3), m, of every loop of the border within the surface.

        The widest loop of a shell is its outer border. So is one in an upright side of the whole surface's box to which
        the surface only comes: where a survey was cut, what overhangs, as a crown does, leaves one there.
        """
        return [box for shell in self._border_loops for box in shell[1:] if not self._cut(box)]

    def _cut(self, box: Float64Array) -> bool:
        """Tell whether the loop in this box (2, 3) is where the surface ends at a side of its own box."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        reach = SIDE_TOLERANCE * float((high - low).max())
        here = ((self.vertices >= box[0] - reach) & (self.vertices <= box[1] + reach)).all(
            axis=1
        ) & self.border_vertices
        around = self.vertices[self.triangles[here[self.triangles].any(axis=1)]].reshape(-1, 3)
        for axis in (0, 1):
            for side in (low[axis], high[axis]):
                within = np.abs(box[:, axis] - side).max() <= reach
                if within and np.abs(around[:, axis] - side).max() > reach:
                    return True
        return False

    def crowded_edges(self) -> Float64Array:
        """Return the middles (e, 3), m, of the edges at which more than two triangles meet."""
        unique, _, counts = self._edges
        middles: Float64Array = self.vertices[unique[counts > 2]].mean(axis=1)
        return middles

    def turned_edges(self) -> Float64Array:
        """Return the middles (e, 3), m, of the edges whose two triangles have their fronts on different sides."""
        unique, edges, counts = self._edges
        ends = np.stack([self.triangles[:, list(edge)] for edge in EDGES], axis=1)
        runs = np.zeros(len(unique), np.int64)
        np.add.at(runs, edges, np.where(ends[..., 0] < ends[..., 1], 1, -1))
        middles: Float64Array = self.vertices[unique[(counts == 2) & (runs != 0)]].mean(axis=1)
        return middles

    def volumes(self) -> dict[int, tuple[float, Float64Array]]:
        """Return by shell the volume that it encloses, m3, negative where it faces inwards, and its box (2, 3), m."""
        middle = self.vertices.mean(axis=0)
        a, b, c = (self.corners[:, corner] - middle for corner in range(3))
        parts = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
        found = {}
        shell = self.shells[self.triangles[:, 0]]
        for number in np.unique(shell):
            points = self.corners[shell == number].reshape(-1, 3)
            found[int(number)] = float(parts[shell == number].sum()), np.array([points.min(0), points.max(0)])
        return found

    def turns_around(self, points: Float64Array) -> Float64Array:
        """Return how often the surface turns around points (p, 3): 1 inside a closed body, 0 outside.

        The sum of the triangles' solid angles (Van Oosterom and Strackee 1983) over 4 pi.
        """
        turns = np.zeros(len(points))
        for index, point in enumerate(points):
            a, b, c = (self.corners[:, corner] - point for corner in range(3))
            la, lb, lc = (np.linalg.norm(arm, axis=1) for arm in (a, b, c))
            triple = np.einsum("ti,ti->t", a, np.cross(b, c))
            dots = (np.einsum("ti,ti->t", one, other) for one, other in ((a, b), (b, c), (c, a)))
            ab, bc, ca = dots
            turns[index] = 2 * np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (4 * np.pi)
        return turns


def _cross_of(vertices: Float64Array, triangles: IntArray) -> Float64Array:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    normals: Float64Array = np.cross(b - a, c - a)
    return normals


def _connected(edges: IntArray, count: int) -> IntArray:
    """Return for each vertex (count,) the lowest index that edges (e, 2) connect it with."""
    labels = np.arange(count)
    while True:
        lowest = labels.copy()
        smaller = np.minimum(labels[edges[:, 0]], labels[edges[:, 1]])
        np.minimum.at(lowest, edges[:, 0], smaller)
        np.minimum.at(lowest, edges[:, 1], smaller)
        # jump to the label's own label, so that long chains take few rounds
        lowest = np.minimum(lowest, lowest[lowest])
        if (lowest == labels).all():
            return labels
        labels = lowest
