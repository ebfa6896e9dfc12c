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

    def holes(self) -> list[Float64Array]:
        """Return the lowest and highest corner (2, 3), m, of every border loop but the widest of each sheet."""
        unique, _, counts = self._edges
        if not (counts == 1).any():
            return []
        loops = _connected(unique[counts == 1], len(self.vertices))
        sheets = _connected(unique, len(self.vertices))
        boxes: dict[int, list[Float64Array]] = {}
        for loop in np.unique(loops[self.border_vertices]):
            members = self.border_vertices & (loops == loop)
            points = self.vertices[members]
            boxes.setdefault(int(sheets[np.argmax(members)]), []).append(np.array([points.min(0), points.max(0)]))
        found = []
        for sheet in boxes.values():
            sheet.sort(key=lambda box: float(np.linalg.norm(box[1] - box[0])))
            found += sheet[:-1]
        return found


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
