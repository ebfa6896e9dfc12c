"""Which splats touch which 16 x 16 tile, in order of depth, compiled for the CPU.

All of it takes a few milliseconds on one thread, less than threads would lose by waiting for each other
on a busy machine.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.projection_kernels import DEPTH, EXTENT_X, EXTENT_Y, MEAN_X, MEAN_Y, conic_of

TILE = 16
RADIX_BITS = 11


@njit(cache=True, error_model="numpy")
def depth_order(screen):
    """Return the indices of the visible splats, near to far, equal depths in index order.

    Positive float32 numbers sort like their bits, so three passes of an 11-bit radix sort do.
    """
    count = 0
    for s in range(len(screen)):
        count += screen[s, EXTENT_X] > 0
    order = np.empty(count, np.int32)
    depths = np.empty(count, np.float32)
    position = 0
    for s in range(len(screen)):
        if screen[s, EXTENT_X] > 0:
            order[position], depths[position] = s, screen[s, DEPTH]
            position += 1
    keys = depths.view(np.uint32)
    other_order, other_keys = np.empty_like(order), np.empty_like(keys)
    for digit in range(3):
        shift = np.uint32(RADIX_BITS * digit)
        starts = np.zeros((1 << RADIX_BITS) + 1, np.int64)
        for i in range(count):
            starts[((keys[i] >> shift) & np.uint32((1 << RADIX_BITS) - 1)) + 1] += 1
        for i in range(1 << RADIX_BITS):
            starts[i + 1] += starts[i]
        for i in range(count):
            bucket = (keys[i] >> shift) & np.uint32((1 << RADIX_BITS) - 1)
            other_order[starts[bucket]], other_keys[starts[bucket]] = order[i], keys[i]
            starts[bucket] += 1
        order, other_order = other_order, order
        keys, other_keys = other_keys, keys
    return order


@njit(cache=True, error_model="numpy")
def tile_row_span(splat, tile_row, columns):
    """Return the first tile and one past the last tile of a row that the splat's ellipse touches.

    The ellipse a dx^2 + 2 b dx dy + c dy^2 = q reaches furthest right at dy = -b/c dx; where that point
    lies outside the row, the nearest edge of the row decides.
    """
    a, b, c = conic_of(splat)
    extent_x, extent_y = float(splat[EXTENT_X]), float(splat[EXTENT_Y])
    low = max(tile_row * TILE - splat[MEAN_Y], -extent_y)
    high = min((tile_row + 1) * TILE - splat[MEAN_Y], extent_y)
    # extent_x = sqrt(q Sigma_xx) and Sigma_xx = c / det(conic)
    reach = extent_x * extent_x * (a * c - b * b) / c
    top = min(max(-b / c * extent_x, low), high)
    right = (-b * top + math.sqrt(max(b * b * top * top - a * (c * top * top - reach), 0.0))) / a
    bottom = min(max(b / c * extent_x, low), high)
    left = (-b * bottom - math.sqrt(max(b * b * bottom * bottom - a * (c * bottom * bottom - reach), 0.0))) / a
    first = math.floor((splat[MEAN_X] + left) / TILE)
    last = math.floor((splat[MEAN_X] + right) / TILE) + 1
    return min(max(first, 0), columns), min(max(last, 0), columns)


@njit(cache=True, error_model="numpy")
def tile_rows(splat, rows):
    """Return the first tile row and one past the last that the splat's box touches."""
    first = math.floor((splat[MEAN_Y] - splat[EXTENT_Y]) / TILE)
    last = math.floor((splat[MEAN_Y] + splat[EXTENT_Y]) / TILE) + 1
    return min(max(first, 0), rows), min(max(last, 0), rows)


@njit(cache=True, error_model="numpy")
def count_tiles(screen, order, columns, rows, counts):
    """Write how many tiles each visible splat touches into `counts` (splat,)."""
    for i in range(len(order)):
        splat = screen[order[i]]
        first_row, last_row = tile_rows(splat, rows)
        total = 0
        for row in range(first_row, last_row):
            first, last = tile_row_span(splat, row, columns)
            total += max(last - first, 0)
        counts[order[i]] = total


@njit(cache=True, error_model="numpy")
def list_tiles(screen, order, columns, rows, starts, slot_splats, slot_tiles):
    """Write splat and tile of every slot; a splat's slots are adjacent, and nearer splats come first."""
    for i in range(len(order)):
        splat = screen[order[i]]
        slot = starts[order[i]]
        first_row, last_row = tile_rows(splat, rows)
        for row in range(first_row, last_row):
            first, last = tile_row_span(splat, row, columns)
            for column in range(first, last):
                slot_splats[slot] = order[i]
                slot_tiles[slot] = row * columns + column
                slot += 1


@njit(cache=True, error_model="numpy")
def slot_starts(order, counts):
    """Return where each visible splat's slots start, and the number of slots."""
    starts = np.zeros(len(counts), np.int64)
    total = 0
    for i in range(len(order)):
        starts[order[i]] = total
        total += counts[order[i]]
    return starts, total


@njit(cache=True, error_model="numpy")
def tile_lists(slot_tiles, tile_count):
    """Return the slots grouped by tile, in slot order, and where each tile's group starts."""
    starts = np.zeros(tile_count + 1, np.int64)
    for slot in range(len(slot_tiles)):
        starts[slot_tiles[slot] + 1] += 1
    for tile in range(tile_count):
        starts[tile + 1] += starts[tile]
    cursor = starts[:-1].copy()
    slots = np.empty(len(slot_tiles), np.int32)
    for slot in range(len(slot_tiles)):
        tile = slot_tiles[slot]
        slots[cursor[tile]] = slot
        cursor[tile] += 1
    return slots, starts
