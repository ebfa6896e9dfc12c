"""The sparse grid (slideframe.tiles) and the order of particles on it.

`columns[c] + k` is the node of layer k in column c. Nodes lie in memory tile by tile, the tiles of one colour after
those of another, so that the order of nodes is also the order in which particles are sorted.
"""

from typing import Any

import warp as wp

from slideframe.tiles import LAYERS_AROUND, TILE

from .reals import Matrix, Real, Vector, Vector6

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(TILE)
LAYERS_AROUND = wp.constant(LAYERS_AROUND)


@wp.func
def first_node(position: Vector) -> wp.vec3i:
    """Return the lowest of the 27 nodes around a position in cells."""
    return wp.vec3i(int(position[0] - Real(0.5)), int(position[1] - Real(0.5)), int(position[2] - Real(0.5)))


@wp.func
def column_of(node: wp.vec3i, corner: wp.vec2i, across: int) -> int:
    """Return the column of a node; the first column stands at `corner`, and `across` columns fill a row."""
    return (node[0] - corner[0]) * across + node[1] - corner[1]


@wp.func
def place_of(node: int, columns: wp.array(dtype=int), owners: wp.array(dtype=int), corner: wp.vec2i, across: int):
    """Return the place i, j, k of a node in the whole grid."""
    column = owners[node]
    return corner[0] + column // across, corner[1] + column % across, node - columns[column]


@wp.kernel
def bound_columns(positions: wp.array(dtype=Vector), bounds: wp.array(dtype=int)):
    """Lower the first two bounds, and raise the last two, to the columns of the particles' first nodes."""
    node = first_node(positions[wp.tid()])
    wp.atomic_min(bounds, 0, node[0])
    wp.atomic_min(bounds, 1, node[1])
    wp.atomic_max(bounds, 2, node[0])
    wp.atomic_max(bounds, 3, node[1])


@wp.kernel
def bound_tiles(
    positions: wp.array(dtype=Vector),
    corner: wp.vec2i,
    tiles: wp.vec2i,
    lowest: wp.array(dtype=int),
    highest: wp.array(dtype=int),
):
    """Find the lowest and the highest first node in each tile."""
    node = first_node(positions[wp.tid()])
    tile = (node[0] - corner[0]) // TILE * tiles[1] + (node[1] - corner[1]) // TILE
    wp.atomic_min(lowest, tile, node[2])
    wp.atomic_max(highest, tile, node[2])


@wp.func
def rank_of(row: int, column: int, tiles: wp.vec2i) -> int:
    """Return the place of a tile in memory: colour by colour; `tiles` are even."""
    half = tiles[1] // 2
    return (row % 2 * 2 + column % 2) * (tiles[0] // 2) * half + row // 2 * half + column // 2


@wp.kernel
def size_tiles(
    lowest: wp.array(dtype=int),
    highest: wp.array(dtype=int),
    tiles: wp.vec2i,
    bases: wp.array(dtype=int),
    sizes: wp.array(dtype=int),
):
    """Find each tile's lowest layer and, at its rank, its number of nodes."""
    tile = wp.tid()
    row = tile // tiles[1]
    column = tile % tiles[1]
    low = lowest[tile]
    high = highest[tile]
    for i in range(wp.max(row - 1, 0), wp.min(row + 2, tiles[0])):
        for j in range(wp.max(column - 1, 0), wp.min(column + 2, tiles[1])):
            low = wp.min(low, lowest[i * tiles[1] + j])
            high = wp.max(high, highest[i * tiles[1] + j])
    height = wp.where(high >= low, high - low + LAYERS_AROUND, 0)
    bases[tile] = low - 1
    sizes[rank_of(row, column, tiles)] = height * TILE * TILE


@wp.kernel
def place_columns(
    bases: wp.array(dtype=int),
    starts: wp.array(dtype=int),
    tiles: wp.vec2i,
    columns: wp.array(dtype=int),
    owners: wp.array(dtype=int),
):
    """Note where each column's layer 0 would lie in memory, and to which column each node belongs."""
    column = wp.tid()
    across = tiles[1] * TILE
    i = column // across
    j = column % across
    tile = i // TILE * tiles[1] + j // TILE
    rank = rank_of(i // TILE, j // TILE, tiles)
    height = (starts[rank + 1] - starts[rank]) // (TILE * TILE)
    start = starts[rank] + (i % TILE * TILE + j % TILE) * height
    columns[column] = start - bases[tile]
    for node in range(start, start + height):
        owners[node] = column


@wp.kernel
def key_particles(
    positions: wp.array(dtype=Vector),
    columns: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    keys: wp.array(dtype=int),
    order: wp.array(dtype=int),
):
    """Write each particle's first node, by which particles are sorted, and its place before sorting."""
    particle = wp.tid()
    node = first_node(positions[particle])
    keys[particle] = columns[column_of(node, corner, across)] + node[2]
    order[particle] = particle


@wp.kernel
def reorder(first: int, order: wp.array(dtype=int), source: wp.array(dtype=Any), target: wp.array(dtype=Any)):
    """Copy an array of particles into the new order."""
    place = first + wp.tid()
    target[place] = source[order[place]]


for element in (int, Real, Vector, Vector6, Matrix):
    wp.overload(reorder, {"source": wp.array(dtype=element), "target": wp.array(dtype=element)})
