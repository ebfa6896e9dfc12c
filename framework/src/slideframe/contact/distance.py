"""Signed distance from the nodes of a grid to a triangle mesh, near its surface only."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.contact.mesh import BoolArray, IntArray, TriangleMesh
from slideframe.problem.grid import Grid

# Pairs of a node and a triangle that are looked at together: some hundred bytes each.
PAIRS_AT_ONCE = 400_000
# Triangles longer than this many cells are searched piece by piece, since the box around a slanted one is mostly empty.
LONGEST_PIECE = 4.0


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
    """Return the nodes of `grid` within `reach` cells of the mesh."""
    spacing, origin, shape = grid.spacing, np.array(grid.origin), np.array(grid.shape)
    cells = TriangleMesh((mesh.vertices - origin) / spacing, mesh.triangles)
    best = _nearest_triangles(cells, shape, reach)
    nodes = np.stack(np.unravel_index(best[0], tuple(shape)), axis=1)
    points = nodes.astype(np.float64)
    closest, feature = closest_points(points, cells.corners[best[1]])
    direction, border = _outward(cells, best[1], feature)
    away = points - closest
    lengths = np.linalg.norm(away, axis=1)
    signs = np.where(np.einsum("mi,mi->m", away, direction) < 0, -1.0, 1.0)
    # on the surface itself the way out is the surface's normal
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    gradient = np.divide(signs[:, None] * away, lengths[:, None], out=direction.copy(), where=lengths[:, None] > 1e-6)
    return NearNodes(nodes, signs * lengths * spacing, gradient, border)


def _nearest_triangles(cells: TriangleMesh, shape: IntArray, reach: float) -> tuple[IntArray, IntArray]:
    """Return the flat indices of nodes within `reach` of the mesh, and for each its nearest triangle."""
    found: list[tuple[IntArray, IntArray, Float64Array]] = []
    pieces, parents = _pieces(cells.corners)
    offsets = np.einsum("ti,ti->t", cells.corners[:, 0], cells.face_normals)
    for index, parent in _pairs(pieces, parents, shape, reach):
        normal = cells.face_normals[parent]
        plane = sum(axis * component for axis, component in zip(index, normal.T, strict=True)) - offsets[parent]
        near = np.flatnonzero(np.abs(plane) <= reach)
        index, parent = tuple(axis[near] for axis in index), parent[near]
        points = np.stack(index, axis=1).astype(np.float64)
        closest, _ = closest_points(points, cells.corners[parent])
        squared = ((points - closest) ** 2).sum(axis=1)
        within = squared <= reach**2
        node = np.ravel_multi_index(tuple(axis[within] for axis in index), tuple(shape))
        found.append(_nearest(node.astype(np.int64), parent[within], squared[within]))
    if not found:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    node, parent, _ = _nearest(*(np.concatenate(part) for part in zip(*found, strict=True)))
    return node, parent


def _nearest(node: IntArray, parent: IntArray, squared: Float64Array) -> tuple[IntArray, IntArray, Float64Array]:
    """Keep for each node its nearest triangle, of equals the first."""
    order = np.lexsort((parent, squared, node))
    node, parent, squared = node[order], parent[order], squared[order]
    first = np.ones(len(node), bool)
    first[1:] = node[1:] != node[:-1]
    return node[first], parent[first], squared[first]


def _pieces(corners: Float64Array) -> tuple[Float64Array, IntArray]:
    """Halve triangles (t, 3, 3) at their longest edge until none is long; return pieces and whose they are."""
    parents, done = np.arange(len(corners)), []
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = lengths.max(axis=1) > LONGEST_PIECE
        done.append((corners[~long], parents[~long]))
        corners, parents, edge = corners[long], parents[long], lengths[long].argmax(axis=1)
        row = np.arange(len(corners))
        a, b, c = (corners[row, (edge + shift) % 3] for shift in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        parents = np.concatenate([parents, parents])
    return np.concatenate([part for part, _ in done]), np.concatenate([part for _, part in done])


def _pairs(
    pieces: Float64Array, parents: IntArray, shape: IntArray, reach: float
) -> Iterator[tuple[tuple[IntArray, ...], IntArray]]:
    """Give, a batch at a time, indices i, j, k and parents of all nodes in the boxes around pieces (t, 3, 3)."""
    low = np.clip(np.ceil(pieces.min(axis=1) - reach), 0, shape).astype(np.int64)
    high = np.clip(np.floor(pieces.max(axis=1) + reach) + 1, 0, shape).astype(np.int64)
    sizes = np.maximum(high - low, 0)
    counts = sizes.prod(axis=1)
    low, sizes, parents, counts = (part[counts > 0] for part in (low, sizes, parents, counts))
    batch = np.cumsum(counts) // PAIRS_AT_ONCE
    for part in np.split(np.arange(len(counts)), np.flatnonzero(np.diff(batch)) + 1):
        which = np.repeat(part, counts[part])
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts[part]) - counts[part], counts[part])
        rest, k = np.divmod(place, sizes[which, 2])
        i, j = np.divmod(rest, sizes[which, 1])
        yield tuple(low[which, axis] + step for axis, step in enumerate((i, j, k))), parents[which]


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
