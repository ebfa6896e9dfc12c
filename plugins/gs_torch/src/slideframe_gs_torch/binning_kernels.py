"""Which splats touch which tile, and in which of its pixel rows, in order of depth, compiled for the CPU."""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.projection_kernels import DEPTH, EXTENT_X, EXTENT_Y, HALF_CHORD, MEAN_X, MEAN_Y, SLOPE, TOP_X

# Tiles are narrow, so that a row holds few pixels that a splat does not reach, and high, so that they are no more
# than square ones of as many pixels would be. Sixteen numbers fill the widest vector registers: two rows.
TILE_WIDTH, TILE_HEIGHT = 8, 32
ROWS_AT_ONCE = 2
RADIX_BITS = 11
# Where tasks keep the order of depth each is a run of splats: at least so many, and at most so many runs.
SHORTEST_RUN, MOST_RUNS = 8192, 64
# Rows are clipped outside the ellipse by this much, since its numbers are float32: px, and a share of its height.
CLIP_MARGIN, CLIP_SHARE = 0.01, 5e-4


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


@njit(nogil=True, cache=True, error_model="numpy")
def gather(first_task, last_task, order, screen, ordered):
    """Copy the visible splats' rows into their order of depth."""
    for i in range(first_task, last_task):
        for column in range(screen.shape[1]):
            ordered[i, column] = screen[order[i], column]


@njit(cache=True, error_model="numpy")
def tile_columns(splat, columns):
    """Return the first tile column and one past the last that the splat's box touches."""
    first = math.floor((splat[MEAN_X] - splat[EXTENT_X] - 0.5) / TILE_WIDTH)
    last = math.floor((splat[MEAN_X] + splat[EXTENT_X] - 0.5) / TILE_WIDTH) + 1
    return min(max(first, 0), columns), min(max(last, 0), columns)


@njit(cache=True, error_model="numpy")
def strip_starts(screen, columns):
    """Return where each splat's strips, its parts in one column of tiles, start (drawn + 1,)."""
    starts = np.zeros(len(screen) + 1, np.int32)
    for i in range(len(screen)):
        first, last = tile_columns(screen[i], columns)
        starts[i + 1] = starts[i] + max(last - first, 0)
    return starts


@njit(nogil=True, cache=True, error_model="numpy")
def clip_strips(first_task, last_task, screen, columns, height, starts, strips):
    """Write the first pixel row of each strip and one past the last into `strips` (strip, 2).

    The ellipse's upper and lower edge are y = slope x +- chord sqrt(1 - (x / extent)^2); the upper one is highest at
    its top, or where the strip comes closest to it, and the lower one likewise, mirrored.
    """
    for i in range(first_task, last_task):
        splat = screen[i]
        extent, slope, chord, top = splat[EXTENT_X], splat[SLOPE], splat[HALF_CHORD], splat[TOP_X]
        margin = CLIP_MARGIN + CLIP_SHARE * chord
        column, _ = tile_columns(splat, columns)
        for strip in range(starts[i], starts[i + 1]):
            left = min(max(column * TILE_WIDTH + 0.5 - splat[MEAN_X], -extent), extent)
            right = min(max(column * TILE_WIDTH + TILE_WIDTH - 0.5 - splat[MEAN_X], -extent), extent)
            upper, lower = min(max(top, left), right), min(max(-top, left), right)
            high = slope * upper + chord * math.sqrt(max((1 - upper / extent) * (1 + upper / extent), 0.0)) + margin
            low = slope * lower - chord * math.sqrt(max((1 - lower / extent) * (1 + lower / extent), 0.0)) - margin
            low, high = max(low, -splat[EXTENT_Y] - margin), min(high, splat[EXTENT_Y] + margin)
            strips[strip, 0] = min(max(math.ceil(splat[MEAN_Y] + low - 0.5), 0), height)
            strips[strip, 1] = min(max(math.floor(splat[MEAN_Y] + high - 0.5) + 1, strips[strip, 0]), height)
            column += 1


@njit(nogil=True, cache=True, error_model="numpy")
def count_entries(first_task, last_task, length, screen, order, columns, starts, strips, tile_counts, slot_counts):
    """Count the splats of each tile, and the tiles of each splat. A task is a run of `length` splats.

    Args:
        first_task: the first run.
        last_task: one past the last run.
        length: splats of a run.
        screen: (drawn, SCREEN_COLUMNS), near to far.
        order: (drawn,), which splat each row of `screen` is.
        columns: tiles in a row.
        starts: (drawn + 1,), where each splat's strips start.
        strips: (strip, 2), pixel rows.
        tile_counts: (run, tile), zero, out.
        slot_counts: (splat,), zero, out.
    """
    for run in range(first_task, last_task):
        for i in range(run * length, min((run + 1) * length, len(screen))):
            column, _ = tile_columns(screen[i], columns)
            slots = 0
            for strip in range(starts[i], starts[i + 1]):
                if strips[strip, 1] > strips[strip, 0]:
                    first, last = strips[strip, 0] // TILE_HEIGHT, (strips[strip, 1] - 1) // TILE_HEIGHT
                    for row in range(first, last + 1):
                        tile_counts[run, row * columns + column] += 1
                    slots += last + 1 - first
                column += 1
            slot_counts[order[i]] = slots


@njit(nogil=True, cache=True, error_model="numpy")
def fill_entries(
    first_task, last_task, length, screen, order, columns, starts, strips, first_entries, first_slots,
    entry_splats, entry_rows, entry_slots, slot_starts,
):  # fmt: skip
    """Write every tile's splats, near to far. A task is a run of `length` splats.

    Args:
        first_task: the first run.
        last_task: one past the last run.
        length: splats of a run.
        screen: (drawn, SCREEN_COLUMNS), near to far.
        order: (drawn,), which splat each row of `screen` is.
        columns: tiles in a row.
        starts: (drawn + 1,), where each splat's strips start.
        strips: (strip, 2), pixel rows.
        first_entries: (run, tile), where the run's entries of each tile start; overwritten.
        first_slots: (run,), where its slots start.
        entry_splats: (entry,), out, rows of `screen`.
        entry_rows: (entry, 2), out, first pixel row within the tile and one past the last, both even.
        entry_slots: (entry,), out, where the entry's gradient goes; a splat's slots are adjacent.
        slot_starts: (splat,), zero, out, where each splat's slots start.
    """
    for run in range(first_task, last_task):
        cursor, slot = first_entries[run], first_slots[run]
        for i in range(run * length, min((run + 1) * length, len(screen))):
            column, _ = tile_columns(screen[i], columns)
            slot_starts[order[i]] = slot
            for strip in range(starts[i], starts[i + 1]):
                low, high = strips[strip, 0], strips[strip, 1]
                if high > low:
                    for row in range(low // TILE_HEIGHT, (high - 1) // TILE_HEIGHT + 1):
                        tile = row * columns + column
                        k = cursor[tile]
                        cursor[tile] += 1
                        entry_splats[k], entry_slots[k] = i, slot
                        first, last = max(low - row * TILE_HEIGHT, 0), min(high - row * TILE_HEIGHT, TILE_HEIGHT)
                        entry_rows[k, 0] = first // ROWS_AT_ONCE * ROWS_AT_ONCE
                        entry_rows[k, 1] = -(-last // ROWS_AT_ONCE) * ROWS_AT_ONCE
                        slot += 1
                column += 1
