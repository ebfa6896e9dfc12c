"""Colours to the levels of a picture, compiled for the CPU: one pass over what the rasteriser leaves in planes."""

import numpy as np
from numba import njit

_FULL, _HALF = np.float32(255), np.float32(0.5)


@njit(nogil=True, cache=True, error_model="numpy")
def write_levels(colour, levels):
    """Write the nearest of 256 levels of each colour (height, width, 3), 0 to 1, beyond which it is cut."""
    height, width, channels = colour.shape
    for row in range(height):
        for column in range(width):
            for channel in range(channels):
                value = colour[row, column, channel] * _FULL + _HALF
                levels[row, column, channel] = np.uint8(min(max(value, _HALF), _FULL))
