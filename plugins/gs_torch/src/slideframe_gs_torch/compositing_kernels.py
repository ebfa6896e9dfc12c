"""Front-to-back compositing of tiles and its gradient, compiled for the CPU.

A tile is a task of its own; inside it the splats are the outer loop and its rows of 16 pixels the
inner one, all in one 1-D scratch buffer with constant offsets and unsigned indices: signed indices or
several buffers cost the vectorisation of the rows, which is five to seven times the time. Every sum has
one order, so images and gradients are the same bits for any number of threads.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.binning_kernels import TILE
from slideframe_gs_torch.projection_kernels import (
    BLUE,
    DEPTH,
    EXTENT_Y,
    GREEN,
    MEAN_X,
    MEAN_Y,
    OPACITY,
    RED,
    ROOT_U,
    ROOT_V,
    ROOT_W,
    SMALLEST_ALPHA,
)

LARGEST_ALPHA = 0.99
# A tile is left once no pixel passes more light than this (Kerbl et al. 2023); looked at every few splats.
OPAQUE_TRANSMITTANCE = 1e-4
SPLATS_BETWEEN_LOOKS = 8

CHANNELS = 4  # red, green, blue, depth

# Where a tile's rows lie in the scratch buffer; the transmittance comes first.
_PIXELS = np.uint64(TILE * TILE)
_LANES = np.uint64(TILE)
_AT_RED, _AT_GREEN, _AT_BLUE, _AT_DEPTH, _AT_LANE, _AT_ROW, _AT_REST = (np.uint64(k * TILE * TILE) for k in range(1, 8))
_ONE, _ZERO, _HALF = np.float32(1.0), np.float32(0.0), np.float32(0.5)
_LARGEST, _SMALLEST = np.float32(LARGEST_ALPHA), np.float32(SMALLEST_ALPHA)

# exp(x) on [-0.75, 0] to 9e-8 by Chebyshev; exp(8 x) by squaring three times
_E0, _E1, _E2 = np.float32(1.0), np.float32(0.9999916954105753), np.float32(0.49986901666601263)
_E3, _E4, _E5 = np.float32(0.16590582561057154), np.float32(0.03964097489255124), np.float32(0.00576105409858749)
_QUARTER, _FOUR, _LOWEST = np.float32(0.25), np.float32(4.0), np.float32(-0.75)


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def falloff(across, along):
    """Return exp(8 x) with x = -across^2 - along^2; below x = -0.75, where alpha is under its threshold, exp(-6).

    Distances are quarters of standard deviations: 8 (d / 4)^2 = d^2 / 2.
    """
    x = max(-(across * across + along * along), _LOWEST)
    e = _E0 + x * (_E1 + x * (_E2 + x * (_E3 + x * (_E4 + x * _E5))))
    e = e * e
    e = e * e
    return e * e


@njit(cache=True, error_model="numpy")
def row_range(mean_y, extent_y, tile_y):
    """Return the first row of the tile and one past the last whose pixel centres the splat reaches."""
    first = math.ceil(mean_y - extent_y - tile_y - 0.5)
    last = math.floor(mean_y + extent_y - tile_y - 0.5) + 1
    return np.uint64(min(max(first, 0), TILE)), np.uint64(min(max(last, 0), TILE))


@njit(cache=True, error_model="numpy")
def number_pixels(scratch):
    """Write each pixel's lane and row, so that one flat loop can run over whole rows."""
    for row in range(TILE):
        for lane in range(TILE):
            scratch[row * TILE + lane + 5 * TILE * TILE] = lane
            scratch[row * TILE + lane + 6 * TILE * TILE] = row


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def composite(first_task, last_task, screen, slots, slot_splats, tile_starts, columns, image, transmittance, processed):
    """Fill `image` (CHANNELS, height, width), without background, and `transmittance` (height, width).

    `processed` (tile,) receives how many of its slots each tile took before it was opaque.
    """
    height, width = transmittance.shape
    for tile in range(first_task, last_task):
        scratch = np.zeros(TILE * TILE * 7, np.float32)
        number_pixels(scratch)
        for pixel in range(_PIXELS):
            scratch[pixel] = _ONE
        tile_x, tile_y = (tile % columns) * TILE, (tile // columns) * TILE
        taken = 0
        for k in range(tile_starts[tile], tile_starts[tile + 1]):
            splat = screen[slot_splats[slots[k]]]
            u, v, w = _QUARTER * splat[ROOT_U], _QUARTER * splat[ROOT_V], _QUARTER * splat[ROOT_W]
            opacity, red, green, blue, depth = splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH]
            offset_x = np.float32(tile_x) + _HALF - splat[MEAN_X]
            offset_y = np.float32(tile_y) + _HALF - splat[MEAN_Y]
            first, last = row_range(splat[MEAN_Y], splat[EXTENT_Y], tile_y)
            for i in range(first * _LANES, last * _LANES):
                dx, dy = offset_x + scratch[i + _AT_LANE], offset_y + scratch[i + _AT_ROW]
                across, along = u * dx + v * dy, w * dy
                alpha = min(opacity * falloff(across, along), _LARGEST)
                alpha = alpha if alpha >= _SMALLEST else _ZERO
                weight = scratch[i] * alpha
                scratch[i] -= weight
                scratch[i + _AT_RED] += weight * red
                scratch[i + _AT_GREEN] += weight * green
                scratch[i + _AT_BLUE] += weight * blue
                scratch[i + _AT_DEPTH] += weight * depth
            taken += 1
            if taken % SPLATS_BETWEEN_LOOKS == 0:
                brightest = _ZERO
                for pixel in range(_PIXELS):
                    brightest = max(brightest, scratch[pixel])
                if brightest < OPAQUE_TRANSMITTANCE:
                    break
        processed[tile] = taken
        for row in range(min(TILE, height - tile_y)):
            for lane in range(min(TILE, width - tile_x)):
                transmittance[tile_y + row, tile_x + lane] = scratch[row * TILE + lane]
                for channel in range(CHANNELS):
                    image[channel, tile_y + row, tile_x + lane] = scratch[
                        (channel + 1) * TILE * TILE + row * TILE + lane
                    ]


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def composite_backward(
    first_task,
    last_task,
    screen,
    slots,
    slot_splats,
    tile_starts,
    columns,
    processed,
    image,
    transmittance,
    d_image,
    d_transmittance,
    moments,
):
    """Fill `moments` (slot, MOMENT_COLUMNS) with the pixels' gradients, one slot per splat and tile.

    Goes front to back again. With e = <dL/dC, c> of a splat and the rest R = sum of w e over the splats
    behind it + T_end dL/dT_end, dL/dalpha = T e - R / (1 - alpha). The moments are those of
    alpha dL/dalpha = dL/dpower in units of sigma about the splat's mean; then come w dL/dC.
    """
    height, width = transmittance.shape
    for tile in range(first_task, last_task):
        scratch = np.zeros(TILE * TILE * 8, np.float32)
        number_pixels(scratch)
        tile_x, tile_y = (tile % columns) * TILE, (tile // columns) * TILE
        for row in range(min(TILE, height - tile_y)):
            for lane in range(min(TILE, width - tile_x)):
                i, y, x = row * TILE + lane, tile_y + row, tile_x + lane
                scratch[i] = _ONE
                rest = transmittance[y, x] * d_transmittance[y, x]
                for channel in range(CHANNELS):
                    scratch[i + (channel + 1) * TILE * TILE] = d_image[channel, y, x]
                    rest += d_image[channel, y, x] * image[channel, y, x]
                scratch[i + 7 * TILE * TILE] = rest
        for k in range(tile_starts[tile], tile_starts[tile] + processed[tile]):
            slot = slots[k]
            splat = screen[slot_splats[slot]]
            u, v, w = _QUARTER * splat[ROOT_U], _QUARTER * splat[ROOT_V], _QUARTER * splat[ROOT_W]
            opacity, red, green, blue, depth = splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH]
            offset_x = np.float32(tile_x) + _HALF - splat[MEAN_X]
            offset_y = np.float32(tile_y) + _HALF - splat[MEAN_Y]
            first, last = row_range(splat[MEAN_Y], splat[EXTENT_Y], tile_y)
            m_0 = m_t = m_s = m_tt = m_ts = m_ss = w_red = w_green = w_blue = w_depth = _ZERO
            for i in range(first * _LANES, last * _LANES):
                dx, dy = offset_x + scratch[i + _AT_LANE], offset_y + scratch[i + _AT_ROW]
                across, along = u * dx + v * dy, w * dy
                raw = opacity * falloff(across, along)
                alpha = min(raw, _LARGEST)
                alpha = alpha if alpha >= _SMALLEST else _ZERO
                weight = scratch[i] * alpha
                g_red, g_green = scratch[i + _AT_RED], scratch[i + _AT_GREEN]
                g_blue, g_depth = scratch[i + _AT_BLUE], scratch[i + _AT_DEPTH]
                share = weight * (g_red * red + g_green * green + g_blue * blue + g_depth * depth)
                rest = scratch[i + _AT_REST] - share
                pull = share - alpha * rest / (_ONE - alpha)
                pull = pull if raw < _LARGEST else _ZERO
                scratch[i] -= weight
                scratch[i + _AT_REST] = rest
                m_0 += pull
                m_t += pull * across
                m_s += pull * along
                m_tt += pull * across * across
                m_ts += pull * across * along
                m_ss += pull * along * along
                w_red += weight * g_red
                w_green += weight * g_green
                w_blue += weight * g_blue
                w_depth += weight * g_depth
            out = moments[slot]
            out[0], out[1], out[2] = m_0, _FOUR * m_t, _FOUR * m_s
            out[3], out[4], out[5] = _FOUR * _FOUR * m_tt, _FOUR * _FOUR * m_ts, _FOUR * _FOUR * m_ss
            out[6], out[7], out[8], out[9] = w_red, w_green, w_blue, w_depth
        for k in range(tile_starts[tile] + processed[tile], tile_starts[tile + 1]):
            moments[slots[k]] = _ZERO
