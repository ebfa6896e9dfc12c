"""A step of every splat that a photograph shows, compiled for the CPU: its losses of its own, and Adam.

A splat that the photograph doesn't show keeps its numbers and its moments: otherwise those that few photographs see
would be moved by what they remember, and fade by their regularisation alone (the reasoning of Mallick et al. 2024,
"Taming 3DGS", sect. 4.3). A task is a block of splats; each splat's step depends on nothing else.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.anisotropy import LARGEST_EXACT_RATIO

BLOCK = 256
FIRST_DECAY, SECOND_DECAY = 0.9, 0.999

# What `pressure` holds: weights per splat, and in metres.
ANISOTROPY_WEIGHT, ANISOTROPY_LIMIT, OPACITY_WEIGHT, SIZE_WEIGHT, LOWEST, HIGHEST = range(6)

_B1, _B2 = np.float32(FIRST_DECAY), np.float32(SECOND_DECAY)
_C1, _C2 = np.float32(1 - FIRST_DECAY), np.float32(1 - SECOND_DECAY)
_TINY = np.float32(1e-15)


@njit(cache=True, error_model="numpy", inline="always")
def adam(numbers, first, gradient, given, count, pace, widen):
    """Move `count` numbers from index `first` on along their gradient from `given` on (Kingma & Ba 2015).

    `numbers` are flat arrays of values, means and squares; pace and widen undo the moments' bias.
    """
    values, mean, square = numbers
    for k in range(count):
        g = gradient[given + k]
        m = _B1 * mean[first + k] + _C1 * g
        v = _B2 * square[first + k] + _C2 * g * g
        mean[first + k] = m
        square[first + k] = v
        values[first + k] -= pace * m / (math.sqrt(v) * widen + _TINY)


@njit(cache=True, error_model="numpy", inline="always")
def add_shape_gradient(gradient, scales, row, pressure):
    """Add, by the logarithms of the scales, the gradient of `anisotropy_loss` and of the size."""
    first, largest, smallest = 3 * row, 3 * row, 3 * row
    for i in range(first, first + 3):
        gradient[i] = gradient[i] * scales[i] + pressure[SIZE_WEIGHT] * scales[i]
        if scales[i] > scales[largest]:
            largest = i
        if scales[i] < scales[smallest]:
            smallest = i
    if scales[largest] > pressure[ANISOTROPY_LIMIT] * scales[smallest]:
        pull = pressure[ANISOTROPY_WEIGHT] * min(scales[largest] / scales[smallest], np.float32(LARGEST_EXACT_RATIO))
        gradient[largest] += pull
        gradient[smallest] -= pull


@njit(nogil=True, fastmath={"contract", "arcp"}, cache=True, error_model="numpy")
def step_splats(
    first_task, last_task, rows, pulls, steps, scales, opacities, rates, pressure,
    centers, rotations, log_scales, logits, harmonics, gradients,
):  # fmt: skip
    """Move the splats of blocks whose pixels pull at them.

    Args:
        first_task: the first block.
        last_task: one past the last block.
        rows: (row,), the splats that were drawn.
        pulls: (row, 2), sums of |gradients|: 0 where a splat is not seen.
        steps: (splat,), how often each was moved, counted up here.
        scales: (3 rows,), exp of the log-scales.
        opacities: (row,), of the logits.
        rates: (6,), of the five, in two for the harmonics: the constant one and the others.
        pressure: (6,), see ANISOTROPY_WEIGHT.
        centers: values, means and squares, flat (3 splats,).
        rotations: likewise (4 splats,).
        log_scales: likewise (3 splats,).
        logits: likewise (splat,).
        harmonics: likewise (3 terms splats,).
        gradients: by centre, rotation, scale, opacity and the first harmonics of each row, flat; overwritten.
    """
    d_centers, d_rotations, d_scales, d_opacities, d_harmonics = gradients
    count = len(rows)
    terms, given = len(harmonics[0]) // len(steps), len(d_harmonics) // max(count, 1)
    for row in range(first_task * BLOCK, min(last_task * BLOCK, count)):
        if pulls[row, 0] == 0 and pulls[row, 1] == 0:
            continue
        s = rows[row]
        steps[s] += 1
        shrink = np.float32(1 / (1 - FIRST_DECAY ** steps[s]))
        widen = np.float32(1 / math.sqrt(1 - SECOND_DECAY ** steps[s]))
        add_shape_gradient(d_scales, scales, row, pressure)
        opacity = opacities[row]
        d_opacities[row] = (d_opacities[row] + pressure[OPACITY_WEIGHT]) * opacity * (np.float32(1) - opacity)
        adam(centers, 3 * s, d_centers, 3 * row, 3, rates[0] * shrink, widen)
        adam(rotations, 4 * s, d_rotations, 4 * row, 4, rates[1] * shrink, widen)
        adam(log_scales, 3 * s, d_scales, 3 * row, 3, rates[2] * shrink, widen)
        adam(logits, s, d_opacities, row, 1, rates[3] * shrink, widen)
        adam(harmonics, terms * s, d_harmonics, given * row, 3, rates[4] * shrink, widen)
        adam(harmonics, terms * s + 3, d_harmonics, given * row + 3, given - 3, rates[5] * shrink, widen)
        for i in range(3 * s, 3 * s + 3):
            log_scales[0][i] = min(max(log_scales[0][i], pressure[LOWEST]), pressure[HIGHEST])
