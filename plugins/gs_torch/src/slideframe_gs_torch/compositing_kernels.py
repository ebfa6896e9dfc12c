"""Front-to-back compositing of tiles and its gradient, compiled for the CPU.

A tile is a task of its own; inside it the splats are the outer loop and the pixel rows that a splat reaches the
inner one, all in one 1-D scratch buffer with constant offsets and unsigned indices: signed indices or several
buffers cost the vectorisation of the rows, which is five to seven times the time (`benchmarks/splats.py` looks at
the machine code). Every sum has one order, so images and gradients are the same bits for any number of threads.

Distances are quarters of standard deviations and the opacity sits in the exponent: with x = log(opacity) / 8 -
across^2 - along^2 a splat's alpha is exp(8 x), and at least 1/255 where x >= -log(255) / 8.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.binning_kernels import TILE_HEIGHT, TILE_WIDTH
from slideframe_gs_torch.projection_kernels import LOG_OPACITY, MEAN_X, MEAN_Y, ROOT_U, ROOT_V, ROOT_W, SMALLEST_ALPHA

LARGEST_ALPHA = 0.99
# A pixel that passes less light than this is done, and a tile whose pixels all are is left; looked at every few splats.
# Kerbl et al. (2023) stop at 1e-4, which costs the gradients of what lies behind their fourth digit; the pose's, a sum
# over all splats of which most cancels, needs another three.
OPAQUE_TRANSMITTANCE = np.float32(1e-7)
SPLATS_BETWEEN_LOOKS = 12
# Splats whose numbers are fetched together.
BATCH = 64
# Light left where a pixel counts as having reached the surface, for the median depth.
MEDIAN_TRANSMITTANCE = np.float32(0.5)

CHANNELS = 3

# Columns of a slot's gradient: moments of dL/dx in units of sigma (1, t, s, tt, ts, ss with t = u dx + v dy and
# s = w dy), then weighted gradients of the three channels.
MOMENT_COLUMNS = 9

# Where a tile's planes lie in the scratch buffer; the transmittance comes first.
PLANE = TILE_WIDTH * TILE_HEIGHT
PIXELS, LANES = np.uint64(PLANE), np.uint64(TILE_WIDTH)
AT_FIRST, AT_SECOND, AT_THIRD, AT_LANE, AT_ROW, AT_REST, AT_TAKEN = (np.uint64(k * PLANE) for k in range(1, 8))
AT_MEDIAN, AT_LEFT = AT_FIRST, AT_REST
SCRATCH = 8 * PLANE
# Vectors that straddle cache lines cost double.
CACHE_LINE = 64

_ONE, _ZERO, _QUARTER, _FOUR = np.float32(1.0), np.float32(0.0), np.float32(0.25), np.float32(4.0)
_LARGEST, _FAINTEST = np.float32(LARGEST_ALPHA), np.float32(math.log(SMALLEST_ALPHA) / 8)

# exp(x) on [-0.75, 0] to 9e-8 by Chebyshev; exp(8 x) by squaring three times
_E0, _E1, _E2 = np.float32(1.0), np.float32(0.9999916954105753), np.float32(0.49986901666601263)
_E3, _E4, _E5 = np.float32(0.16590582561057154), np.float32(0.03964097489255124), np.float32(0.00576105409858749)


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def exp_of_eight(x):
    """Return exp(8 x) for x in [-0.75, 0]; further down it is not to be looked at.

    Pairs of terms are independent of one another: what limits the rows is the length of this chain.
    """
    square = x * x
    e = (_E0 + x * _E1) + square * ((_E2 + x * _E3) + square * (_E4 + x * _E5))
    e = e * e
    e = e * e
    return e * e


@njit(cache=True, error_model="numpy")
def aligned_scratch():
    """Return the zeroed buffer of a tile, on a cache line, with each pixel's lane and row written into it."""
    room = np.zeros(SCRATCH + CACHE_LINE // 4, np.float32)
    skipped = (CACHE_LINE - room.ctypes.data % CACHE_LINE) % CACHE_LINE // 4
    scratch = room[skipped : skipped + SCRATCH]
    for row in range(TILE_HEIGHT):
        for lane in range(TILE_WIDTH):
            scratch[row * TILE_WIDTH + lane + 4 * PLANE] = lane
            scratch[row * TILE_WIDTH + lane + 5 * PLANE] = row
    return scratch


@njit(cache=True, error_model="numpy")
def stage_batch(staged, first, last, tile_x, tile_y, screen, paint, entry_splats):
    """Write what a tile needs of its next splats into `staged` (BATCH, 9), so that none is waited for alone.

    The columns are a, b, c, d, e, f with across = a lane + b row + c, along = d row + e and f = log(opacity) / 8, and
    the paint.
    """
    for k in range(first, last):
        splat, out = screen[entry_splats[k]], staged[k - first]
        u, v, w = 0.25 * splat[ROOT_U], 0.25 * splat[ROOT_V], 0.25 * splat[ROOT_W]
        offset_x, offset_y = tile_x + 0.5 - splat[MEAN_X], tile_y + 0.5 - splat[MEAN_Y]
        out[0], out[1], out[2] = u, v, u * offset_x + v * offset_y
        out[3], out[4], out[5] = w, w * offset_y, 0.125 * splat[LOG_OPACITY]
        for channel in range(CHANNELS):
            out[6 + channel] = paint[entry_splats[k], channel]


@njit(cache=True, error_model="numpy", inline="always")
def terms_of(row):
    """Return a row of what is staged as numbers."""
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]


@njit(cache=True, error_model="numpy", inline="always")
def close_pixels(scratch, number):
    """Let no more light into pixels that are done after `number` splats; return how many still pass some.

    What a done pixel has left moves to another plane, so that the rows need not ask.
    """
    passing = np.uint32(0)
    for i in range(PIXELS):
        light = scratch[i]
        passes = light > OPAQUE_TRANSMITTANCE
        passing += np.uint32(passes)
        scratch[i + AT_TAKEN] = number if light > _ZERO else scratch[i + AT_TAKEN]
        scratch[i + AT_LEFT] += _ZERO if passes else light
        scratch[i] = light if passes else _ZERO
    return passing


@njit(cache=True, error_model="numpy")
def clear_tile(scratch, rows, lanes):
    """Let all light pass the tile's pixels that lie in the image, and nothing be seen."""
    scratch[: 4 * PLANE] = 0.0
    for row in range(rows):
        for lane in range(lanes):
            scratch[row * TILE_WIDTH + lane] = 1.0


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def composite(
    first_task, last_task, columns, screen, paint, tile_starts, entry_splats, entry_rows,
    background, image, transmittance, taken, processed,
):  # fmt: skip
    """Fill `image` (CHANNELS, height, width), over the background, and `transmittance` (height, width).

    Args:
        first_task: the first tile.
        last_task: one past the last tile.
        columns: tiles in a row.
        screen: (drawn, SCREEN_COLUMNS), near to far.
        paint: (drawn, CHANNELS), what each splat shows.
        tile_starts: (tile + 1,), where each tile's entries start.
        entry_splats: (entry,), rows of `screen`.
        entry_rows: (entry, 2), the first pixel row of the tile that the splat reaches and one past the last.
        background: (CHANNELS,), float32.
        image: out.
        transmittance: out.
        taken: (height, width), out, only where a pixel was done: how many of its tile's entries it took before.
        processed: (tile,), out: how many entries each tile took before it was opaque.
    """
    height, width = transmittance.shape
    scratch, staged = aligned_scratch(), np.empty((BATCH, 9), np.float32)
    for tile in range(first_task, last_task):
        tile_x, tile_y = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
        rows, lanes = min(TILE_HEIGHT, height - tile_y), min(TILE_WIDTH, width - tile_x)
        clear_tile(scratch, rows, lanes)
        scratch[6 * PLANE :] = 0.0
        start, stop = tile_starts[tile], tile_starts[tile + 1]
        k = start
        while k < stop:
            if (k - start) % BATCH == 0:
                stage_batch(staged, k, min(k + BATCH, stop), tile_x, tile_y, screen, paint, entry_splats)
            a, b, c, d, e, f, first, second, third = terms_of(staged[(k - start) % BATCH])
            for i in range(np.uint64(entry_rows[k, 0]) * LANES, np.uint64(entry_rows[k, 1]) * LANES):
                across, along = a * scratch[i + AT_LANE] + (b * scratch[i + AT_ROW] + c), d * scratch[i + AT_ROW] + e
                x = f - along * along - across * across
                alpha = min(exp_of_eight(x), _LARGEST)
                light = scratch[i]
                weight = light * (alpha if x >= _FAINTEST else _ZERO)
                scratch[i] = light - weight
                scratch[i + AT_FIRST] += weight * first
                scratch[i + AT_SECOND] += weight * second
                scratch[i + AT_THIRD] += weight * third
            k += 1
            if (k - start) % SPLATS_BETWEEN_LOOKS == 0 and close_pixels(scratch, np.float32(k - start)) == 0:
                break
        processed[tile] = k - start
        close_pixels(scratch, np.float32(k - start))
        for row in range(rows):
            for lane in range(lanes):
                left = scratch[row * TILE_WIDTH + lane] + scratch[6 * PLANE + row * TILE_WIDTH + lane]
                transmittance[tile_y + row, tile_x + lane] = left
                if left <= OPAQUE_TRANSMITTANCE:
                    taken[tile_y + row, tile_x + lane] = scratch[7 * PLANE + row * TILE_WIDTH + lane]
                for channel in range(CHANNELS):
                    seen = scratch[(channel + 1) * PLANE + row * TILE_WIDTH + lane]
                    image[channel, tile_y + row, tile_x + lane] = seen + left * background[channel]


@njit(cache=True, error_model="numpy")
def load_gradient(
    scratch, tile_x, tile_y, rows, lanes, count, background, transmittance, taken, d_image, d_transmittance
):
    """Start a tile's backward pass behind its `count` splats: the light left, and T (dL/dT + <dL/dC, background>)."""
    scratch[: 4 * PLANE] = 0.0
    scratch[6 * PLANE :] = 0.0
    for row in range(rows):
        for lane in range(lanes):
            i, y, x = row * TILE_WIDTH + lane, tile_y + row, tile_x + lane
            behind = d_transmittance[y, x]
            for channel in range(CHANNELS):
                scratch[i + (channel + 1) * PLANE] = d_image[channel, y, x]
                behind += d_image[channel, y, x] * background[channel]
            left = transmittance[y, x]
            scratch[i], scratch[i + 6 * PLANE] = left, left * behind
            scratch[i + 7 * PLANE] = taken[y, x] if left <= OPAQUE_TRANSMITTANCE else count


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def composite_backward(
    first_task, last_task, columns, screen, paint, tile_starts, entry_splats, entry_rows,
    entry_slots, processed, background, transmittance, taken, d_image, d_transmittance, moments,
):  # fmt: skip
    """Fill `moments` (slot, MOMENT_COLUMNS) with the pixels' gradients, one slot per splat and tile.

    Goes back to front. With s = <dL/dC, c> of a splat, the light T that reaches it, and the rest R = sum of w s over
    the splats behind it + T_end dL/dT_end, dL/dalpha = T s - R / (1 - alpha). R is added up from behind: taken off
    from the front, what remains behind a thousand splats would be the rounding of the first. The moments are those
    of alpha dL/dalpha = dL/d(8 x); then come w dL/dC. `entry_slots` (entry,) are rows of `moments`; see `composite`.
    """
    height, width = transmittance.shape
    scratch, staged = aligned_scratch(), np.empty((BATCH, 9), np.float32)
    for tile in range(first_task, last_task):
        tile_x, tile_y = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
        rows, lanes = min(TILE_HEIGHT, height - tile_y), min(TILE_WIDTH, width - tile_x)
        load_gradient(
            scratch, tile_x, tile_y, rows, lanes, processed[tile],
            background, transmittance, taken, d_image, d_transmittance,
        )  # fmt: skip
        start, stop = tile_starts[tile], tile_starts[tile] + processed[tile]
        for k in range(stop - 1, start - 1, -1):
            place = (k - start) % BATCH
            if place == BATCH - 1 or k == stop - 1:
                stage_batch(staged, k - place, k + 1, tile_x, tile_y, screen, paint, entry_splats)
            a, b, c, d, e, f, first, second, third = terms_of(staged[place])
            index = np.float32(k - start)
            m_0 = m_t = m_s = m_tt = m_ts = m_ss = w_first = w_second = w_third = _ZERO
            for i in range(np.uint64(entry_rows[k, 0]) * LANES, np.uint64(entry_rows[k, 1]) * LANES):
                across, along = a * scratch[i + AT_LANE] + (b * scratch[i + AT_ROW] + c), d * scratch[i + AT_ROW] + e
                x = f - along * along - across * across
                raw = exp_of_eight(x)
                alpha = min(raw, _LARGEST) if (x >= _FAINTEST) & (index < scratch[i + AT_TAKEN]) else _ZERO
                spread = _ONE / (_ONE - alpha)
                light, rest = scratch[i] * spread, scratch[i + AT_REST]
                weight = light * alpha
                g_first, g_second, g_third = scratch[i + AT_FIRST], scratch[i + AT_SECOND], scratch[i + AT_THIRD]
                share = weight * (g_first * first + g_second * second + g_third * third)
                pull = share - alpha * spread * rest
                pull = pull if raw < _LARGEST else _ZERO
                scratch[i] = light
                scratch[i + AT_REST] = rest + share
                pull_across, pull_along = pull * across, pull * along
                m_0 += pull
                m_t += pull_across
                m_s += pull_along
                m_tt += pull_across * across
                m_ts += pull_across * along
                m_ss += pull_along * along
                w_first += weight * g_first
                w_second += weight * g_second
                w_third += weight * g_third
            out = moments[entry_slots[k]]
            out[0], out[1], out[2] = m_0, _FOUR * m_t, _FOUR * m_s
            out[3], out[4], out[5] = _FOUR * _FOUR * m_tt, _FOUR * _FOUR * m_ts, _FOUR * _FOUR * m_ss
            out[6], out[7], out[8] = w_first, w_second, w_third
        for k in range(stop, tile_starts[tile + 1]):
            moments[entry_slots[k]] = _ZERO


@njit(nogil=True, cache=True, error_model="numpy")
def sum_paint(first_task, last_task, slot_starts, slot_counts, moments, d_paint):
    """Sum each splat's gradients by what it shows over its tiles into `d_paint` (splat, CHANNELS)."""
    for s in range(first_task, last_task):
        for channel in range(CHANNELS):
            total = 0.0
            for k in range(slot_starts[s], slot_starts[s] + slot_counts[s]):
                total += moments[k, 6 + channel]
            d_paint[s, channel] = total


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def find_median(first_task, last_task, columns, screen, tile_starts, entry_splats, entry_rows, processed, median):
    """Write the row of `screen` at which half of a pixel's light is gone into `median` (height, width), else -1.

    The scratch buffer holds the row as a float32, which is exact up to 2^24 splats.
    """
    height, width = median.shape
    no_paint = np.zeros((len(screen), CHANNELS), np.float32)
    scratch, staged = aligned_scratch(), np.empty((BATCH, 9), np.float32)
    for tile in range(first_task, last_task):
        tile_x, tile_y = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
        rows, lanes = min(TILE_HEIGHT, height - tile_y), min(TILE_WIDTH, width - tile_x)
        clear_tile(scratch, rows, lanes)
        scratch[PLANE : 2 * PLANE] = -1.0
        start, stop = tile_starts[tile], tile_starts[tile] + processed[tile]
        for k in range(start, stop):
            if (k - start) % BATCH == 0:
                stage_batch(staged, k, min(k + BATCH, stop), tile_x, tile_y, screen, no_paint, entry_splats)
            a, b, c, d, e, f, _, _, _ = terms_of(staged[(k - start) % BATCH])
            index = np.float32(entry_splats[k])
            for i in range(np.uint64(entry_rows[k, 0]) * LANES, np.uint64(entry_rows[k, 1]) * LANES):
                across, along = a * scratch[i + AT_LANE] + (b * scratch[i + AT_ROW] + c), d * scratch[i + AT_ROW] + e
                x = f - along * along - across * across
                alpha = min(exp_of_eight(x), _LARGEST) if x >= _FAINTEST else _ZERO
                left = scratch[i] - scratch[i] * alpha
                crossed = scratch[i] > MEDIAN_TRANSMITTANCE and left <= MEDIAN_TRANSMITTANCE
                scratch[i + AT_MEDIAN] = index if crossed else scratch[i + AT_MEDIAN]
                scratch[i] = left
        for row in range(rows):
            for lane in range(lanes):
                median[tile_y + row, tile_x + lane] = np.int32(scratch[PLANE + row * TILE_WIDTH + lane])
