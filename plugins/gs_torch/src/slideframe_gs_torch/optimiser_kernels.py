"""Adam (Kingma & Ba 2015), compiled for the CPU.

One thread does it: the ends of a thread's share would be rounded unlike its vectorised middle, so the
result would depend on the number of threads, and memory is the limit anyway.
"""

import math

import numpy as np
from numba import njit


@njit(fastmath=True, cache=True, error_model="numpy")
def adam(values, gradient, mean, square, rate, step, first_decay, second_decay, epsilon):
    """Move flat `values` one step; `step` counts from 1."""
    b1, b2 = np.float32(first_decay), np.float32(second_decay)
    c1, c2 = np.float32(1 - first_decay), np.float32(1 - second_decay)
    pace = np.float32(rate / (1 - first_decay**step))
    widen = np.float32(1 / math.sqrt(1 - second_decay**step))
    tiny = np.float32(epsilon)
    for i in range(len(values)):
        g = gradient[i]
        m = b1 * mean[i] + c1 * g
        v = b2 * square[i] + c2 * g * g
        mean[i] = m
        square[i] = v
        values[i] -= pace * m / (math.sqrt(v) * widen + tiny)
