"""Colours to the levels of a picture, compiled for the CPU: one pass over what the rasteriser leaves in planes."""

import numpy as np
from numba import njit

_FULL, _HALF = np.float32(255), np.float32(0.5)


@njit(nogil=True, cache=True, error_model="numpy")
def write_levels(first_row, last_row, planes, levels):
    """Write the nearest of 256 levels (height, width, 3) of colours (3, height, width), 0 to 1, beyond which it is cut.

    Rows are shared out among threads; the planes lie one after the other in memory, else no loop is vectorised.
    """
    for row in range(first_row, last_row):
        for column in range(planes.shape[2]):
            for channel in range(3):
                value = planes[channel, row, column] * _FULL + _HALF
                levels[row, column, channel] = np.uint8(min(max(value, _HALF), _FULL))
