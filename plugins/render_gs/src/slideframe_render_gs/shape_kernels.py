"""Shapes of deformed splats, compiled for the CPU: quaternion and scales of F S F^T, in blocks of splats.

With S = A A^T the columns of M = F A, turned among themselves until they are orthogonal, are the new axes:
one-sided Jacobi (Hestenes 1958). A block's matrices lie entry by entry in one array, so that a step of the
iteration is one vectorised loop over its splats.
"""

import math

import numpy as np
from numba import njit

from slideframe_render_gs.deformation_kernels import can_touch

# Splats of a block. A column of its matrices is one array: all first entries, all second, all third.
# Unsigned, because a loop over numbers that might be negative isn't vectorised.
SPLATS = 64
LANES, SECOND, THIRD = np.uint64(SPLATS), np.uint64(SPLATS), np.uint64(2 * SPLATS)
# Convergence is quadratic: a sweep that met no larger squared cosine than this leaves cosines of a millionth.
ALMOST_ORTHOGONAL = np.float32(1e-6)
MOST_SWEEPS = 10
_TINY = np.float32(1e-30)
_ZERO, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)


@njit(cache=True, error_model="numpy", fastmath=True)
def turn_columns(a, b):
    """Turn two columns of every matrix in their plane until they are orthogonal.

    Returns whether all their squared cosines were below ALMOST_ORTHOGONAL before.
    """
    excess = _ZERO
    for lane in range(LANES):
        a0, a1, a2 = a[lane], a[SECOND + lane], a[THIRD + lane]
        b0, b1, b2 = b[lane], b[SECOND + lane], b[THIRD + lane]
        aa, bb, ab = a0 * a0 + a1 * a1 + a2 * a2, b0 * b0 + b1 * b1 + b2 * b2, a0 * b0 + a1 * b1 + a2 * b2
        excess += max(ab * ab - ALMOST_ORTHOGONAL * (aa * bb), _ZERO)  # a sum: a loop for the largest isn't vectorised
        # the smaller root of t^2 + 2 zeta t - 1 with zeta = (bb - aa) / (2 ab), without dividing by ab
        apart, twice = bb - aa, _TWO * ab
        length = abs(apart) + math.sqrt(apart * apart + twice * twice) + _TINY
        tangent = math.copysign(_ONE, apart) * twice / length
        cosine = _ONE / math.sqrt(_ONE + tangent * tangent)
        sine = cosine * tangent
        a[lane], b[lane] = cosine * a0 - sine * b0, sine * a0 + cosine * b0
        a[SECOND + lane], b[SECOND + lane] = cosine * a1 - sine * b1, sine * a1 + cosine * b1
        a[THIRD + lane], b[THIRD + lane] = cosine * a2 - sine * b2, sine * a2 + cosine * b2
    return excess == _ZERO


@njit(cache=True, error_model="numpy", fastmath=True)
def orthogonalise(first, second, third):
    """Turn the columns of every matrix of the block until they are orthogonal."""
    for _ in range(MOST_SWEEPS):
        done = turn_columns(first, second)
        done &= turn_columns(first, third)
        done &= turn_columns(second, third)
        if done:
            break


@njit(cache=True, error_model="numpy", fastmath=True)
def normalise(column, lengths):
    """Take the lengths off a column of every matrix, into `lengths` (lane,)."""
    for lane in range(LANES):
        x, y, z = column[lane], column[SECOND + lane], column[THIRD + lane]
        length = math.sqrt(x * x + y * y + z * z)
        shrink = _ONE / (length + _TINY)
        lengths[lane] = length
        column[lane], column[SECOND + lane], column[THIRD + lane] = x * shrink, y * shrink, z * shrink


@njit(cache=True, error_model="numpy")
def load(columns, lane, F, axes):
    """Write M = F A into a lane of the block, seen as (column, entry, lane)."""
    for j in range(3):
        for i in range(3):
            columns[j, i, lane] = F[i, 0] * axes[0, j] + F[i, 1] * axes[1, j] + F[i, 2] * axes[2, j]


@njit(cache=True, error_model="numpy")
def unload(columns, lengths, lane, M, quaternion, scale):
    """Write a lane's lengths and the quaternion of its unit columns; `M` (3, 3) is working space."""
    least = 0
    for j in range(3):
        scale[j] = lengths[j, lane]
        least = j if lengths[j, lane] < lengths[least, lane] else least
        M[0, j], M[1, j], M[2, j] = columns[j, 0, lane], columns[j, 1, lane], columns[j, 2, lane]
    # the shortest axis is the cross product of the other two, so that the rotation is proper
    p, q = (least + 1) % 3, (least + 2) % 3
    M[0, least] = M[1, p] * M[2, q] - M[2, p] * M[1, q]
    M[1, least] = M[2, p] * M[0, q] - M[0, p] * M[2, q]
    M[2, least] = M[0, p] * M[1, q] - M[1, p] * M[0, q]
    write_quaternion(M, quaternion)


@njit(cache=True, error_model="numpy")
def write_quaternion(M, quaternion):
    """Write the unit quaternion wxyz of a rotation M, from the largest of its four components."""
    xx, yy, zz = M[0, 0], M[1, 1], M[2, 2]
    w, x, y, z = _ONE + xx + yy + zz, M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]
    if xx + yy + zz < 0:
        if xx >= yy and xx >= zz:
            w, x, y, z = x, _ONE + xx - yy - zz, M[1, 0] + M[0, 1], M[0, 2] + M[2, 0]
        elif yy >= zz:
            w, x, y, z = y, M[1, 0] + M[0, 1], _ONE - xx + yy - zz, M[2, 1] + M[1, 2]
        else:
            w, x, y, z = z, M[0, 2] + M[2, 0], M[2, 1] + M[1, 2], _ONE - xx - yy + zz
    shrink = _ONE / math.sqrt(w * w + x * x + y * y + z * z)
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = w * shrink, x * shrink, y * shrink, z * shrink


@njit(nogil=True, cache=True, error_model="numpy")
def reshape(
    first_task, last_task, moving, carriers, at_rest, held, turned, axes, varied, radii, camera_from_world, intrinsics,
    rest_rotations, rest_scales, centers, opacities, stale, rotations, scales, frame_rotations,
):  # fmt: skip
    """Bring the shapes of stale splats up to date that can touch the picture.

    `varied` (row,) is whether a splat's colour depends on the direction it is seen from; only then its frame
    is turned.
    """
    block, lengths, used = np.ones(9 * SPLATS, np.float32), np.empty((3, SPLATS), np.float32), 0
    columns, rows, M = block.reshape(3, 3, SPLATS), np.empty(SPLATS, np.int64), np.empty((3, 3), np.float32)
    first, second, third = block[: 3 * SPLATS], block[3 * SPLATS : 6 * SPLATS], block[6 * SPLATS :]
    for row in range(first_task, last_task):
        s, k = moving[row], carriers[row]
        if stale[row] and can_touch(centers[s], radii[row], opacities[s], camera_from_world, intrinsics):
            stale[row] = False
            if varied[row]:
                for i in range(3):
                    for j in range(3):
                        frame_rotations[s, i, j] = (1.0 if i == j else 0.0) if at_rest[k] else turned[k, i, j]
            if at_rest[k]:
                rotations[s], scales[s] = rest_rotations[s], rest_scales[s]
            else:
                load(columns, used, held[k], axes[row])
                rows[used] = row
                used += 1
        if used == SPLATS or (used and row == last_task - 1):
            orthogonalise(first, second, third)
            normalise(first, lengths[0])
            normalise(second, lengths[1])
            normalise(third, lengths[2])
            for lane in range(used):
                s = moving[rows[lane]]
                unload(columns, lengths, lane, M, rotations[s], scales[s])
            used = 0
