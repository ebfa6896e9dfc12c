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
LANES, TWICE, THRICE = np.uint64(SPLATS), np.uint64(2 * SPLATS), np.uint64(3 * SPLATS)
SECOND, THIRD = LANES, TWICE
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
def load(columns, lane, F, k, axes, row):
    """Write M = F[k] A[row] into a lane of the block, seen as (column, entry, lane)."""
    for j in range(3):
        x, y, z = axes[row, 0, j], axes[row, 1, j], axes[row, 2, j]
        for i in range(3):
            columns[j, i, lane] = F[k, i, 0] * x + F[k, i, 1] * y + F[k, i, 2] * z


@njit(cache=True, error_model="numpy", fastmath=True)
def write_quaternions(first, second, third, quaternions):
    """Write the unit quaternion wxyz of every rotation of the block, from the largest of its four components.

    The columns are those of a proper rotation: M = F A is proper, and turning its columns leaves it so.
    """
    for lane in range(LANES):
        xx, yx, zx = first[lane], first[SECOND + lane], first[THIRD + lane]
        xy, yy, zy = second[lane], second[SECOND + lane], second[THIRD + lane]
        xz, yz, zz = third[lane], third[SECOND + lane], third[THIRD + lane]
        upright, about_x = xx + yy + zz >= _ZERO, xx >= yy and xx >= zz
        about_y = not about_x and yy >= zz
        w = _ONE + xx + yy + zz if upright else (zy - yz if about_x else (xz - zx if about_y else yx - xy))
        x = zy - yz if upright else (_ONE + xx - yy - zz if about_x else (yx + xy if about_y else xz + zx))
        y = xz - zx if upright else (yx + xy if about_x else (_ONE - xx + yy - zz if about_y else zy + yz))
        z = yx - xy if upright else (xz + zx if about_x else (zy + yz if about_y else _ONE - xx - yy + zz))
        shrink = _ONE / math.sqrt(w * w + x * x + y * y + z * z + _TINY)
        quaternions[lane], quaternions[LANES + lane] = w * shrink, x * shrink
        quaternions[TWICE + lane], quaternions[THRICE + lane] = y * shrink, z * shrink


@njit(cache=True, error_model="numpy")
def unload(splats, used, quaternions, lengths, rotations, scales):
    """Give the first `used` lanes of the block to their splats."""
    for lane in range(used):
        for i in range(4):
            rotations[splats[lane], i] = quaternions[i * SPLATS + lane]
        for i in range(3):
            scales[splats[lane], i] = lengths[i, lane]


@njit(nogil=True, cache=True, error_model="numpy")
def reshape(
    first_task, last_task, moving, carriers, at_rest, held, turned, axes, varied, radii, camera_from_world, intrinsics,
    rest_rotations, rest_scales, centers, opacities, stale, rotations, scales, frame_rotations,
):  # fmt: skip
    """Bring the shapes of stale splats up to date that can touch the picture.

    `varied` (row,) is whether a splat's colour depends on the direction it is seen from; only then its frame
    is turned.
    """
    block, splats, used = np.ones(9 * SPLATS, np.float32), np.empty(SPLATS, np.int64), 0
    columns, lengths = block.reshape(3, 3, SPLATS), np.empty((3, SPLATS), np.float32)
    quaternions = np.empty(4 * SPLATS, np.float32)
    first, second, third = block[: 3 * SPLATS], block[3 * SPLATS : 6 * SPLATS], block[6 * SPLATS :]
    for row in range(first_task, last_task):
        s, k = moving[row], carriers[row]
        if stale[row] and can_touch(centers, s, radii[row], opacities[s], camera_from_world, intrinsics):
            stale[row] = False
            if varied[row]:
                for i in range(3):
                    for j in range(3):
                        frame_rotations[s, i, j] = (1.0 if i == j else 0.0) if at_rest[k] else turned[k, i, j]
            if at_rest[k]:
                for i in range(4):
                    rotations[s, i] = rest_rotations[s, i]
                for i in range(3):
                    scales[s, i] = rest_scales[s, i]
            else:
                load(columns, used, held, k, axes, row)
                splats[used] = s
                used += 1
        if used == SPLATS or (used and row == last_task - 1):
            orthogonalise(first, second, third)
            normalise(first, lengths[0])
            normalise(second, lengths[1])
            normalise(third, lengths[2])
            write_quaternions(first, second, third, quaternions)
            unload(splats, used, quaternions, lengths, rotations, scales)
            used = 0
