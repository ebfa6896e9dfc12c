"""From the gradients of pixels to those of splats and of the camera's pose, compiled for the CPU.

Laid out as `projection_kernels`: a task is a block of splats, column by column in one scratch buffer, in float64.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch.compositing_kernels import MOMENT_COLUMNS
from slideframe_gs_torch.projection_kernels import (
    BLOCK,
    CONTRACT,
    LOW_PASS,
    NEAR,
    QW,
    QX,
    QY,
    QZ,
    ROOT_U,
    ROOT_V,
    ROOT_W,
    SX,
    SY,
    SZ,
    X,
    Y,
    Z,
    camera_point,
    lens_numbers,
    load_splats,
    pose_numbers,
    projected_axes,
    projection_rows,
    rotation_matrix,
)

# Columns of the scratch buffer after those of the splat as given: what the pixels say of mean, covariance (in units
# of sigma) and opacity; u, v, w; then the gradients, whose camera-axes point and J W the pose needs.
D_POWER, D_T, D_S, D_TT, D_TS, D_SS, U, V, W = (np.uint64(k * BLOCK) for k in range(11, 20))
D_CENTER = tuple(np.uint64(k * BLOCK) for k in range(20, 23))
D_ROTATION = tuple(np.uint64(k * BLOCK) for k in range(23, 27))
D_SCALE = tuple(np.uint64(k * BLOCK) for k in range(27, 30))
D_POINT = tuple(np.uint64(k * BLOCK) for k in range(30, 33))
D_TURN = tuple(np.uint64(k * BLOCK) for k in range(33, 42))
SCRATCH = 42 * BLOCK


@njit(cache=True, error_model="numpy")
def gather_moments(scratch, start, count, screen, slot_starts, slot_counts, moments, d_colours, d_means):
    """Sum each splat's gradients over its tiles, in their order, and write those that need no projection.

    `d_means` (splat, 2) receives the sum over tiles of |dL/dmean|, per px: cancellation inside a large
    splat must not hide that it covers too much (the reasoning of AbsGS, Ye et al. 2024).
    """
    total = np.empty(MOMENT_COLUMNS)
    for i in range(count):
        s = start + i
        u, v, w = float(screen[s, ROOT_U]), float(screen[s, ROOT_V]), float(screen[s, ROOT_W])
        if slot_counts[s] == 0:
            u, v, w = 0.0, 0.0, 0.0
        total[:] = 0.0
        pull_x = pull_y = 0.0
        for k in range(slot_starts[s], slot_starts[s] + slot_counts[s]):
            row = moments[k]
            for column in range(MOMENT_COLUMNS):
                total[column] += row[column]
            pull_x += abs(u * row[1])
            pull_y += abs(v * row[1] + w * row[2])
        for column in range(6):
            scratch[i + (11 + column) * BLOCK] = total[column]
        scratch[i + 17 * BLOCK], scratch[i + 18 * BLOCK], scratch[i + 19 * BLOCK] = u, v, w
        d_colours[s, 0], d_colours[s, 1], d_colours[s, 2] = total[6], total[7], total[8]
        d_means[s, 0], d_means[s, 1] = pull_x, pull_y


@njit(cache=True, error_model="numpy", inline="always")
def quaternion_gradient(w, x, y, z, g):
    """Return dL/d(unit quaternion), with its part along the quaternion taken off, from g = dL/dR, row by row."""
    d_w = 2 * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]))
    d_x = 2 * (w * (g[7] - g[5]) - 2 * x * (g[4] + g[8]) + y * (g[1] + g[3]) + z * (g[2] + g[6]))
    d_y = 2 * (w * (g[2] - g[6]) + x * (g[1] + g[3]) - 2 * y * (g[0] + g[8]) + z * (g[5] + g[7]))
    d_z = 2 * (w * (g[3] - g[1]) + x * (g[2] + g[6]) + y * (g[5] + g[7]) - 2 * z * (g[0] + g[4]))
    along = w * d_w + x * d_x + y * d_y + z * d_z
    return d_w - w * along, d_x - x * along, d_y - y * along, d_z - z * along


@njit(cache=True, error_model="numpy", inline="always")
def covariance_gradient(u, v, w, tt, ts, ss):
    """Return dL/dSigma, symmetric: xx, xy, yy, from the second moments M: L^T M L / 2."""
    return 0.5 * u * u * tt, 0.5 * u * (v * tt + w * ts), 0.5 * (v * v * tt + 2 * v * w * ts + w * w * ss)


@njit(cache=True, error_model="numpy", inline="always")
def dimming_gradient(d_log, p):
    """Return dL/dSigma of log opacity + log(det Sigma / det(Sigma + 0.3)) / 2 for P = p (2, 3), row by row."""
    xx, xy, yy = (
        p[0] * p[0] + p[1] * p[1] + p[2] * p[2],
        p[0] * p[3] + p[1] * p[4] + p[2] * p[5],
        p[3] * p[3] + p[4] * p[4] + p[5] * p[5],
    )
    m01, m02, m12 = p[0] * p[4] - p[1] * p[3], p[0] * p[5] - p[2] * p[3], p[1] * p[5] - p[2] * p[4]
    sharp = m01 * m01 + m02 * m02 + m12 * m12
    blurred = sharp + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS
    by_sharp = 0.5 * d_log / max(sharp, 1e-30) - 0.5 * d_log / blurred
    spread = -0.5 * d_log / blurred * LOW_PASS
    return by_sharp * yy + spread, -by_sharp * xy, by_sharp * xx + spread


@njit(cache=True, error_model="numpy", inline="always")
def spread_gradient(xx, xy, yy, p):
    """Return dL/dP = 2 dL/dSigma P (2, 3), row by row, of Sigma = P P^T."""
    xx, xy, yy = 2 * xx, 2 * xy, 2 * yy
    return (
        xx * p[0] + xy * p[3], xx * p[1] + xy * p[4], xx * p[2] + xy * p[5],
        xy * p[0] + yy * p[3], xy * p[1] + yy * p[4], xy * p[2] + yy * p[5],
    )  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def axes_gradient(rows, g):
    """Return dL/d(R S) = (J W)^T g (3, 3), row by row, from g = dL/dP."""
    return (
        rows[0] * g[0] + rows[3] * g[3], rows[0] * g[1] + rows[3] * g[4], rows[0] * g[2] + rows[3] * g[5],
        rows[1] * g[0] + rows[4] * g[3], rows[1] * g[1] + rows[4] * g[4], rows[1] * g[2] + rows[4] * g[5],
        rows[2] * g[0] + rows[5] * g[3], rows[2] * g[1] + rows[5] * g[4], rows[2] * g[2] + rows[5] * g[5],
    )  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def rows_gradient(g, R, scale):
    """Return dL/d(J W) = g (R S)^T (2, 3), row by row, from g = dL/dP."""
    a0, a1, a2 = R[0] * scale[0], R[1] * scale[1], R[2] * scale[2]
    b0, b1, b2 = R[3] * scale[0], R[4] * scale[1], R[5] * scale[2]
    c0, c1, c2 = R[6] * scale[0], R[7] * scale[1], R[8] * scale[2]
    return (
        g[0] * a0 + g[1] * a1 + g[2] * a2, g[0] * b0 + g[1] * b1 + g[2] * b2, g[0] * c0 + g[1] * c1 + g[2] * c2,
        g[3] * a0 + g[4] * a1 + g[5] * a2, g[3] * b0 + g[4] * b1 + g[5] * b2, g[3] * c0 + g[4] * c1 + g[5] * c2,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def turn_gradient(x, y, z, lens, h):
    """Return dL/dW = J^T h (3, 3), row by row, from h = dL/d(J W)."""
    pace_x, pace_y = lens[0] / z, lens[1] / z
    slope_x, slope_y = min(max(x / z, lens[6]), lens[7]), min(max(y / z, lens[8]), lens[9])
    return (
        pace_x * h[0], pace_x * h[1], pace_x * h[2], pace_y * h[3], pace_y * h[4], pace_y * h[5],
        -pace_x * slope_x * h[0] - pace_y * slope_y * h[3],
        -pace_x * slope_x * h[1] - pace_y * slope_y * h[4],
        -pace_x * slope_x * h[2] - pace_y * slope_y * h[5],
    )  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def point_gradient(x, y, z, pose, lens, h, d_u, d_v):
    """Return dL/d(camera-axes point) from h = dL/d(J W) and the pull (d_u, d_v) on the mean, in focal lengths.

    Of dL/dJ = h W^T four entries depend on the point; the slopes do where they lie in the widened frustum.
    """
    d_j00, d_j02 = h[0] * pose[0] + h[1] * pose[1] + h[2] * pose[2], h[0] * pose[8] + h[1] * pose[9] + h[2] * pose[10]
    d_j11, d_j12 = h[3] * pose[4] + h[4] * pose[5] + h[5] * pose[6], h[3] * pose[8] + h[4] * pose[9] + h[5] * pose[10]
    slope_x, slope_y = min(max(x / z, lens[6]), lens[7]), min(max(y / z, lens[8]), lens[9])
    free_x, free_y = (1.0 if slope_x == x / z else 0.0), (1.0 if slope_y == y / z else 0.0)
    pace_x, pace_y = lens[0] / z, lens[1] / z
    d_z = pace_x / z * (-d_u * x - d_j00 + d_j02 * slope_x * (1 + free_x))
    d_z += pace_y / z * (-d_v * y - d_j11 + d_j12 * slope_y * (1 + free_y))
    return pace_x * (d_u - free_x * d_j02 / z), pace_y * (d_v - free_y * d_j12 / z), d_z


@njit(cache=True, error_model="numpy", fastmath=CONTRACT)
def unproject_block(scratch, count, pose, lens, antialiased):
    """Fill a block's gradient columns."""
    dimmed = 1.0 if antialiased else 0.0
    for i in range(np.uint64(count)):
        x, y, depth = camera_point(scratch[i + X], scratch[i + Y], scratch[i + Z], pose)
        z = max(depth, NEAR)
        qw, qx, qy, qz = scratch[i + QW], scratch[i + QX], scratch[i + QY], scratch[i + QZ]
        shrink = 1 / math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw * shrink, qx * shrink, qy * shrink, qz * shrink
        R, scale = rotation_matrix(qw, qx, qy, qz), (scratch[i + SX], scratch[i + SY], scratch[i + SZ])
        rows = projection_rows(x, y, z, pose, lens)
        p = projected_axes(rows, R, scale[0], scale[1], scale[2])
        u, v, w = scratch[i + U], scratch[i + V], scratch[i + W]
        xx, xy, yy = covariance_gradient(u, v, w, scratch[i + D_TT], scratch[i + D_TS], scratch[i + D_SS])
        dim_xx, dim_xy, dim_yy = dimming_gradient(dimmed * scratch[i + D_POWER], p)
        g = spread_gradient(xx + dim_xx, xy + dim_xy, yy + dim_yy, p)
        m = axes_gradient(rows, g)
        for k in range(3):
            scratch[i + D_SCALE[k]] = m[k] * R[k] + m[k + 3] * R[k + 3] + m[k + 6] * R[k + 6]
        sx, sy, sz = scale
        d_rotation = m[0] * sx, m[1] * sy, m[2] * sz, m[3] * sx, m[4] * sy, m[5] * sz, m[6] * sx, m[7] * sy, m[8] * sz
        d_q = quaternion_gradient(qw, qx, qy, qz, d_rotation)
        for k in range(4):
            scratch[i + D_ROTATION[k]] = d_q[k] * shrink
        h = rows_gradient(g, R, scale)
        d_turn = turn_gradient(x, y, z, lens, h)
        for k in range(9):
            scratch[i + D_TURN[k]] = d_turn[k]
        d = point_gradient(x, y, z, pose, lens, h, u * scratch[i + D_T], v * scratch[i + D_T] + w * scratch[i + D_S])
        for k in range(3):
            scratch[i + D_POINT[k]] = d[k]
            scratch[i + D_CENTER[k]] = pose[k] * d[0] + pose[4 + k] * d[1] + pose[8 + k] * d[2]


@njit(cache=True, error_model="numpy")
def sum_pose_gradient(scratch, start, count, slot_counts, d_pose):
    """Write the block's part of dL/d(camera_from_world) into `d_pose` (3, 4)."""
    d_pose[:] = 0.0
    for i in range(count):
        if slot_counts[start + i] > 0:
            for row in range(3):
                d_point = scratch[i + (30 + row) * BLOCK]
                for column in range(3):
                    d_pose[row, column] += (
                        d_point * scratch[i + column * BLOCK] + scratch[i + (33 + 3 * row + column) * BLOCK]
                    )
                d_pose[row, 3] += d_point


@njit(nogil=True, cache=True, error_model="numpy")
def project_backward(
    first_task, last_task, centers, rotations, scales, opacities, camera_from_world, intrinsics, antialiased, screen,
    slot_starts, slot_counts, moments,
    d_centers, d_rotations, d_scales, d_opacities, d_colours, d_means, d_poses,
):  # fmt: skip
    """Carry the pixels' moments back to blocks of splats; every output is overwritten.

    Args:
        first_task: the first block.
        last_task: one past the last block.
        centers: (splat, 3), and the next up to `screen` as in `project`.
        rotations: (splat, 4).
        scales: (splat, 3).
        opacities: (splat,).
        camera_from_world: (3, 4).
        intrinsics: (6,).
        antialiased: as in `project`.
        screen: (splat, SCREEN_COLUMNS), from `project`.
        slot_starts: (splat,), each splat's first row of `moments`.
        slot_counts: (splat,), how many it has; 0 where it is not drawn.
        moments: (slot, MOMENT_COLUMNS).
        d_centers: (splat, 3), out, and the next up to `d_colours` likewise.
        d_rotations: (splat, 4).
        d_scales: (splat, 3).
        d_opacities: (splat,).
        d_colours: (splat, 3).
        d_means: (splat, 2), see `gather_moments`.
        d_poses: (block, 3, 4), out, each block's part of dL/d(camera_from_world).
    """
    pose, lens = pose_numbers(camera_from_world), lens_numbers(intrinsics)
    scratch = np.zeros(SCRATCH)
    for block in range(first_task, last_task):
        start = block * BLOCK
        count = min(BLOCK, len(centers) - start)
        load_splats(scratch, start, count, centers, rotations, scales, opacities)
        gather_moments(scratch, start, count, screen, slot_starts, slot_counts, moments, d_colours, d_means)
        unproject_block(scratch, count, pose, lens, antialiased)
        sum_pose_gradient(scratch, start, count, slot_counts, d_poses[block])
        for i in range(count):
            s = start + i
            drawn = slot_counts[s] > 0
            for k in range(3):
                d_centers[s, k] = scratch[i + (20 + k) * BLOCK] if drawn else 0.0
                d_scales[s, k] = scratch[i + (27 + k) * BLOCK] if drawn else 0.0
            for k in range(4):
                d_rotations[s, k] = scratch[i + (23 + k) * BLOCK] if drawn else 0.0
            d_opacities[s] = scratch[i + 11 * BLOCK] / opacities[s] if drawn else 0.0
