"""Rotations of many things at once: matrices and quaternions (w, x, y, z)."""

import numpy as np

from slideframe.arrays import Float64Array


def rotation_matrices(quaternions: Float64Array) -> Float64Array:
    """Return (n, 3, 3) from quaternions wxyz (n, 4) of any length but zero."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quaternions_of(matrices: Float64Array) -> Float64Array:
    """Return unit quaternions wxyz (n, 4) of rotations (n, 3, 3), from the largest of the four components."""
    m = matrices
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    sum_x, sum_y, sum_z = m[:, 2, 1] + m[:, 1, 2], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 0] + m[:, 0, 1]
    turn_x, turn_y, turn_z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    # row k is 4 q_k q
    candidates = np.array(
        [
            [1 + xx + yy + zz, turn_x, turn_y, turn_z],
            [turn_x, 1 + xx - yy - zz, sum_z, sum_y],
            [turn_y, sum_z, 1 - xx + yy - zz, sum_x],
            [turn_z, sum_y, sum_x, 1 - xx - yy + zz],
        ]
    )
    best = np.argmax(candidates[range(4), range(4)], axis=0)
    chosen = candidates[best, :, np.arange(len(m))]
    unit: Float64Array = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return unit
