"""The sparse grid of explicit solvers: nodes only where particles are, so that memory follows the mass, not the box.

Columns of nodes along z stand in tiles of 4 x 4. A tile's columns are as long as the particles in it and around it need
until one of them has moved by a cell; then all is laid anew. Tiles of one of four colours share no node, so threads
that own tiles need no atomic sums, and the order of every sum is the same for any number of threads.
"""

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from slideframe.errors import StageFailed
from slideframe.guards import available_memory
from slideframe.problem import Grid
from slideframe.products import Filling

# Particles of four layers of cells that drift by a cell reach nodes -1 to 6, and those of the next tile of the same
# colour nodes from 8 - 1.
TILE = 4
COLOURS = 4
# Cells that a particle may have moved before all is laid anew; what is missing to one is for the rounding of positions
# and of the sum of motions.
MOST_DRIFT = 0.9
# A cell of drift either way, and the two nodes above a particle's first.
LAYERS_AROUND = 5
# Spare room in arrays that grow with the run-out, so that they seldom grow.
HEADROOM = 1.25
# What a mass that has spread needs of nodes, to what it needs at t = 0: more is refused when it comes to it.
SPREAD = 2.0
LARGEST_INDEX = int(np.iinfo(np.int32).max)


Pair = tuple[int, int]


def window(lowest: npt.NDArray[np.integer], highest: npt.NDArray[np.integer]) -> tuple[Pair, Pair]:
    """Return the first column and the number of tiles along x and y that hold columns `lowest` to `highest` (2,).

    One tile more stands on either side, and the number is even, so that each colour has as many.
    """
    low, high = lowest // TILE - 1, highest // TILE + 1
    first = TILE * low
    tiles = (high - low + 2) // 2 * 2
    return (int(first[0]), int(first[1])), (int(tiles[0]), int(tiles[1]))


def estimate_nodes(filling: Filling, grid: Grid) -> int:
    """Return how many nodes the filling needs at t = 0 and, with a share for its spreading, later."""
    cells = (filling.particle_positions.astype(np.float64) - np.array(grid.origin)) / grid.spacing
    first = (cells - 0.5).astype(np.int64)
    corner, tiles = window(first[:, :2].min(axis=0), first[:, :2].max(axis=0))
    place = tuple(((first[:, :2] - corner) // TILE).T)
    lowest, highest = np.full(tiles, LARGEST_INDEX), np.full(tiles, -LARGEST_INDEX)
    np.minimum.at(lowest, place, first[:, 2])
    np.maximum.at(highest, place, first[:, 2])
    around = _widest(highest, np.maximum) - _widest(lowest, np.minimum) + LAYERS_AROUND
    return int(SPREAD * TILE**2 * around[around > 0].sum())


def _widest(values: npt.NDArray[np.int64], choose: "np.ufunc") -> npt.NDArray[np.int64]:
    """Return for each tile the extreme of its own and its eight neighbours' values."""
    for axis in (0, 1):
        padded = np.pad(values, [(1, 1) if along == axis else (0, 0) for along in (0, 1)], mode="edge")
        low, middle, high = (np.moveaxis(padded, axis, 0)[shift : shift + values.shape[axis]] for shift in range(3))
        values = np.moveaxis(choose(choose(low, middle), high), 0, axis)
    return values


def runs(starts: npt.NDArray[np.integer], parts: int) -> list[Pair]:
    """Return at most `parts` runs (first, count) of about equal length that are cut at `starts` only."""
    wanted = np.linspace(starts[0], starts[-1], parts + 1)[1:-1]
    above = np.searchsorted(starts, wanted)
    nearer = above - (wanted - starts[above - 1] < starts[above] - wanted)
    cuts = [int(starts[0]), *(int(cut) for cut in starts[nearer]), int(starts[-1])]
    return [(low, high - low) for low, high in pairwise(cuts) if high > low]


def require_room(size: int, node_count: int) -> None:
    """Stop a simulation whose grid outgrows the memory or the indices.

    Raises:
        StageFailed: with what to do.
    """
    if size > available_memory() or node_count > LARGEST_INDEX:
        raise StageFailed(
            f"the mass has spread over {node_count:,} grid nodes, which need {size / 1e9:.1f} GB more",
            where="solver",
            cure="raise grid_spacing, or free memory and run again. Frames before this time are kept",
        )
