"""The sparse grid (slideframe.tiles) and the order of particles on it.

`columns[c] + k` is the node of layer k in column c. Nodes lie in memory tile by tile, the tiles of one colour after
those of another, so that the order of nodes is also the order in which particles are sorted.
"""

import taichi as ti

from slideframe.tiles import LAYERS_AROUND, TILE

from .arrays import Array

Pair = ti.types.vector(2, ti.i32)


@ti.func
def first_node(position):
    """Return the lowest of the 27 nodes around a position in cells."""
    return ti.cast(position - 0.5, ti.i32)


@ti.func
def column_of(node, corner, across):
    """Return the column of a node; the first column stands at `corner`, and `across` columns fill a row."""
    return (node[0] - corner[0]) * across + node[1] - corner[1]


@ti.func
def place_of(node, columns: ti.template(), owners: ti.template(), corner, across):
    """Return the place i, j, k of a node in the whole grid."""
    column = owners[node]
    return corner[0] + column // across, corner[1] + column % across, node - columns[column]


@ti.kernel
def bound_columns(positions: Array, bounds: Array):
    """Lower the first two bounds, and raise the last two, to the columns of the particles' first nodes."""
    for particle in range(positions.shape[0]):
        node = first_node(positions[particle])
        ti.atomic_min(bounds[0], node[0])
        ti.atomic_min(bounds[1], node[1])
        ti.atomic_max(bounds[2], node[0])
        ti.atomic_max(bounds[3], node[1])


@ti.kernel
def bound_tiles(positions: Array, corner: Pair, tiles: Pair, lowest: Array, highest: Array):
    """Find the lowest and the highest first node in each tile."""
    for particle in range(positions.shape[0]):
        node = first_node(positions[particle])
        tile = (node[0] - corner[0]) // TILE * tiles[1] + (node[1] - corner[1]) // TILE
        ti.atomic_min(lowest[tile], node[2])
        ti.atomic_max(highest[tile], node[2])


@ti.func
def rank_of(row, column, tiles):
    """Return the place of a tile in memory: colour by colour; `tiles` are even."""
    half = tiles[1] // 2
    return (row % 2 * 2 + column % 2) * (tiles[0] // 2) * half + row // 2 * half + column // 2


@ti.kernel
def size_tiles(lowest: Array, highest: Array, tiles: Pair, bases: Array, sizes: Array):
    """Find each tile's lowest layer and, at its rank, its number of nodes."""
    for tile in range(tiles[0] * tiles[1]):
        row = tile // tiles[1]
        column = tile % tiles[1]
        low = lowest[tile]
        high = highest[tile]
        for i in range(ti.max(row - 1, 0), ti.min(row + 2, tiles[0])):
            for j in range(ti.max(column - 1, 0), ti.min(column + 2, tiles[1])):
                low = ti.min(low, lowest[i * tiles[1] + j])
                high = ti.max(high, highest[i * tiles[1] + j])
        height = 0
        if high >= low:
            height = high - low + LAYERS_AROUND
        bases[tile] = low - 1
        sizes[rank_of(row, column, tiles)] = height * TILE * TILE


@ti.kernel
def place_columns(bases: Array, starts: Array, tiles: Pair, columns: Array, owners: Array):
    """Note where each column's layer 0 would lie in memory, and to which column each node belongs."""
    for column in range(tiles[0] * tiles[1] * TILE * TILE):
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


@ti.kernel
def key_particles(positions: Array, columns: Array, corner: Pair, across: ti.i32, keys: Array):
    """Write each particle's first node, by which particles are sorted."""
    for particle in range(positions.shape[0]):
        node = first_node(positions[particle])
        keys[particle] = columns[column_of(node, corner, across)] + node[2]


@ti.kernel
def count_keys(keys: Array, starts: Array, node_count: ti.i32):
    """Leave in `starts[node]` the number of particles whose first node comes before."""
    for node in range(node_count + 1):
        starts[node] = 0
    ti.loop_config(serialize=True)
    for particle in range(keys.shape[0]):
        starts[keys[particle]] += 1
    for _ in range(1):
        total = 0
        for node in range(node_count + 1):
            count = starts[node]
            starts[node] = total
            total += count


@ti.kernel
def rank_particles(keys: Array, starts: Array, order: Array):
    """Write into `order` the particles node by node; equals keep their order. Uses up `starts`."""
    ti.loop_config(serialize=True)
    for particle in range(keys.shape[0]):
        key = keys[particle]
        order[starts[key]] = particle
        starts[key] += 1


@ti.kernel
def reorder(order: Array, source: Array, target: Array):
    """Copy an array of particles into the new order."""
    for place in range(order.shape[0]):
        target[place] = source[order[place]]
