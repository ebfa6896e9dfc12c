"""Shapes of deformed splats, compiled for the CPU: quaternion and scales of F S F^T, in blocks of splats.

With S = A A^T the columns of M = F A, turned among themselves until they are orthogonal, are the new axes:
one-sided Jacobi (Hestenes 1958). A block's matrices lie entry by entry in one array, so that a step of the
iteration is one vectorised loop over its splats.
"""

import math

import numpy as np
from numba import njit

from slideframe_render_gs.deformation_kernels import can_touch

# Splats of a block, and where in it column j of every matrix begins: entry i follows LANES after entry i - 1.
LANES = 64
COLUMN = 3 * LANES
# Convergence is quadratic: a sweep that met no larger squared cosine than this leaves cosines of a millionth.
ALMOST_ORTHOGONAL = np.float32(1e-6)
MOST_SWEEPS = 10
_TINY = np.float32(1e-30)
_ONE, _TWO = np.float32(1), np.float32(2)


@njit(cache=True, error_model="numpy", fastmath=True)
def turn_columns(block, p, q):
    """Turn two columns, which begin at p and q, in their plane until they are orthogonal.

    Returns whether all their squared cosines were below ALMOST_ORTHOGONAL before.
    """
    excess = -_ONE
    for lane in range(LANES):
        a0, a1, a2 = block[p + lane], block[p + LANES + lane], block[p + 2 * LANES + lane]
        b0, b1, b2 = block[q + lane], block[q + LANES + lane], block[q + 2 * LANES + lane]
        aa, bb, ab = a0 * a0 + a1 * a1 + a2 * a2, b0 * b0 + b1 * b1 + b2 * b2, a0 * b0 + a1 * b1 + a2 * b2
        excess = max(excess, ab * ab - ALMOST_ORTHOGONAL * (aa * bb))
        # the smaller root of t^2 + 2 zeta t - 1 with zeta = (bb - aa) / (2 ab), without dividing by ab
        apart, twice = bb - aa, _TWO * ab
        length = abs(apart) + math.sqrt(apart * apart + twice * twice) + _TINY
        tangent = (twice if apart >= 0 else -twice) / length
        cosine = _ONE / math.sqrt(_ONE + tangent * tangent)
        sine = cosine * tangent
        block[p + lane], block[q + lane] = cosine * a0 - sine * b0, sine * a0 + cosine * b0
        block[p + LANES + lane], block[q + LANES + lane] = cosine * a1 - sine * b1, sine * a1 + cosine * b1
        block[p + 2 * LANES + lane], block[q + 2 * LANES + lane] = cosine * a2 - sine * b2, sine * a2 + cosine * b2
    return excess <= 0


@njit(cache=True, error_model="numpy", fastmath=True)
def orthogonalise(block):
    """Turn the columns of every matrix of the block until they are orthogonal."""
    for _ in range(MOST_SWEEPS):
        done = turn_columns(block, 0, COLUMN)
        done &= turn_columns(block, 0, 2 * COLUMN)
        done &= turn_columns(block, COLUMN, 2 * COLUMN)
        if done:
            break


@njit(cache=True, error_model="numpy", fastmath=True)
def normalise(block, lengths, start, row):
    """Take the lengths off the columns that begin at `start`, into a row of `lengths` (3, LANES)."""
    for lane in range(LANES):
        x, y, z = block[start + lane], block[start + LANES + lane], block[start + 2 * LANES + lane]
        length = math.sqrt(x * x + y * y + z * z)
        shrink = _ONE / (length + _TINY)
        lengths[row, lane] = length
        block[start + lane], block[start + LANES + lane], block[start + 2 * LANES + lane] = (
            x * shrink, y * shrink, z * shrink,
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def load(block, lane, F, axes):
    """Write M = F A into a lane of the block."""
    for j in range(3):
        for i in range(3):
            block[j * COLUMN + i * LANES + lane] = F[i, 0] * axes[0, j] + F[i, 1] * axes[1, j] + F[i, 2] * axes[2, j]


@njit(cache=True, error_model="numpy")
def unload(block, lengths, lane, M, quaternion, scale):
    """Write a lane's lengths and the quaternion of its unit columns; `M` (3, 3) is working space."""
    least = 0
    for j in range(3):
        start = j * COLUMN + lane
        scale[j] = lengths[j, lane]
        least = j if lengths[j, lane] < lengths[least, lane] else least
        M[0, j], M[1, j], M[2, j] = block[start], block[start + LANES], block[start + 2 * LANES]
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
    block, rows, M = np.ones(3 * COLUMN, np.float32), np.empty(LANES, np.int64), np.empty((3, 3), np.float32)
    lengths, used = np.empty((3, LANES), np.float32), 0
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
                load(block, used, held[k], axes[row])
                rows[used] = row
                used += 1
        if used == LANES or (used and row == last_task - 1):
            orthogonalise(block)
            for column in range(3):
                normalise(block, lengths, column * COLUMN, column)
            for lane in range(used):
                s = moving[rows[lane]]
                unload(block, lengths, lane, M, rotations[s], scales[s])
            used = 0
