"""Elliptical weighted average projection of splats, compiled for the CPU.

A task is a block of splats, whose numbers are laid out column by column in one 1-D scratch buffer, so that the
arithmetic runs in vectors; it is float64, because the covariance of a needle is badly conditioned. Formulas:
Zwicker et al. 2002 (EWA splatting); the low-pass of 0.3 px^2, the widened frustum of the Jacobian and the
thresholds are those of Kerbl et al. 2023; the opacity that makes up for the low-pass is that of Yu et al. 2024
(Mip-Splatting), sqrt(det Sigma / det(Sigma + 0.3)).
"""

import math

import numpy as np
from numba import njit

# Columns of the projected splat. Extents are half sizes of the box, in px, beyond which alpha < 1/255; slope,
# half chord and top describe the ellipse's edge y = slope x +- chord sqrt(1 - (x / extent)^2), highest at x = top.
# The falloff is exp(-((u dx + v dy)^2 + (w dy)^2) / 2), with a Cholesky factor L of the conic K = L^T L, since
# the conic itself loses a needle's width to cancellation in float32.
(
    MEAN_X, MEAN_Y, ROOT_U, ROOT_V, ROOT_W, LOG_OPACITY,
    EXTENT_X, EXTENT_Y, SLOPE, HALF_CHORD, TOP_X, DEPTH,
) = range(12)  # fmt: skip
SCREEN_COLUMNS = 12

LOW_PASS = 0.3
NEAR = 0.2
SMALLEST_ALPHA = 1.0 / 255.0
FRUSTUM_MARGIN = 0.3
# What rounding may add to a bound, px.
BOUND_MARGIN = 0.01

# Splats of one task.
BLOCK = 256
# Columns of a block in the scratch buffer: the splat as given, then as projected; (x, y, z) are camera axes.
X, Y, Z, QW, QX, QY, QZ, SX, SY, SZ, LOG_O, XX, XY, YY, DET, DET_SHARP = (np.uint64(k * BLOCK) for k in range(16))
GIVEN = (X, Y, Z, QW, QX, QY, QZ, SX, SY, SZ, LOG_O)
OUT = tuple(np.uint64((16 + k) * BLOCK) for k in range(SCREEN_COLUMNS))
SCRATCH = 28 * BLOCK
CONTRACT = {"contract", "arcp"}


@njit(cache=True, error_model="numpy")
def rotation_matrix(w, x, y, z):
    """Return the rotation of a unit quaternion, row by row."""
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def pose_numbers(camera_from_world):
    """Return a (3, 4) pose as twelve numbers, which the compiler keeps out of memory."""
    p = camera_from_world
    return (
        p[0, 0], p[0, 1], p[0, 2], p[0, 3], p[1, 0], p[1, 1], p[1, 2], p[1, 3], p[2, 0], p[2, 1], p[2, 2], p[2, 3]
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def lens_numbers(intrinsics):
    """Return fx, fy, cx, cy, width, height and the lowest and highest x/z and y/z at which the Jacobian is taken."""
    fx, fy, cx, cy, width, height = intrinsics
    margin_x, margin_y = FRUSTUM_MARGIN * width / (2 * fx), FRUSTUM_MARGIN * height / (2 * fy)
    return (
        fx, fy, cx, cy, width, height,
        -cx / fx - margin_x, (width - cx) / fx + margin_x, -cy / fy - margin_y, (height - cy) / fy + margin_y,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def load_splats(scratch, start, count, centers, rotations, scales, opacities):
    """Lay a block's splats out column by column."""
    for i in range(count):
        s = start + i
        scratch[i], scratch[i + BLOCK], scratch[i + 2 * BLOCK] = centers[s, 0], centers[s, 1], centers[s, 2]
        for k in range(4):
            scratch[i + (3 + k) * BLOCK] = rotations[s, k]
        for k in range(3):
            scratch[i + (7 + k) * BLOCK] = scales[s, k]
        scratch[i + 10 * BLOCK] = math.log(opacities[s])


@njit(cache=True, error_model="numpy", inline="always")
def camera_point(x, y, z, pose):
    """Return a point (x, y, z) of the world in camera axes."""
    return (
        pose[0] * x + pose[1] * y + pose[2] * z + pose[3],
        pose[4] * x + pose[5] * y + pose[6] * z + pose[7],
        pose[8] * x + pose[9] * y + pose[10] * z + pose[11],
    )


@njit(cache=True, error_model="numpy", inline="always")
def projection_rows(x, y, z, pose, lens):
    """Return J W (2, 3), row by row, of a point in camera axes, z > 0."""
    slope_x = min(max(x / z, lens[6]), lens[7])
    slope_y = min(max(y / z, lens[8]), lens[9])
    pace_x, pace_y = lens[0] / z, lens[1] / z
    return (
        pace_x * (pose[0] - slope_x * pose[8]),
        pace_x * (pose[1] - slope_x * pose[9]),
        pace_x * (pose[2] - slope_x * pose[10]),
        pace_y * (pose[4] - slope_y * pose[8]),
        pace_y * (pose[5] - slope_y * pose[9]),
        pace_y * (pose[6] - slope_y * pose[10]),
    )


@njit(cache=True, error_model="numpy", inline="always")
def projected_axes(rows, R, sx, sy, sz):
    """Return P = J W R S (2, 3), row by row, whose P P^T is the covariance on the screen, px^2."""
    return (
        (rows[0] * R[0] + rows[1] * R[3] + rows[2] * R[6]) * sx,
        (rows[0] * R[1] + rows[1] * R[4] + rows[2] * R[7]) * sy,
        (rows[0] * R[2] + rows[1] * R[5] + rows[2] * R[8]) * sz,
        (rows[3] * R[0] + rows[4] * R[3] + rows[5] * R[6]) * sx,
        (rows[3] * R[1] + rows[4] * R[4] + rows[5] * R[7]) * sy,
        (rows[3] * R[2] + rows[4] * R[5] + rows[5] * R[8]) * sz,
    )


@njit(cache=True, error_model="numpy", fastmath=CONTRACT)
def project_block(scratch, count, pose, lens):
    """Fill a block's columns MEAN_X, MEAN_Y, DEPTH, XX, XY, YY, DET and DET_SHARP, det before the low-pass.

    The determinant is the sum of the squared minors of P (Cauchy and Binet), free of a needle's cancellation.
    """
    for i in range(np.uint64(count)):
        x, y, depth = camera_point(scratch[i + X], scratch[i + Y], scratch[i + Z], pose)
        z = max(depth, NEAR)
        w, a, b, c = scratch[i + QW], scratch[i + QX], scratch[i + QY], scratch[i + QZ]
        shrink = 1 / math.sqrt(w * w + a * a + b * b + c * c)
        R = rotation_matrix(w * shrink, a * shrink, b * shrink, c * shrink)
        rows = projection_rows(x, y, z, pose, lens)
        p0, p1, p2, q0, q1, q2 = projected_axes(rows, R, scratch[i + SX], scratch[i + SY], scratch[i + SZ])
        xx, xy, yy = p0 * p0 + p1 * p1 + p2 * p2, p0 * q0 + p1 * q1 + p2 * q2, q0 * q0 + q1 * q1 + q2 * q2
        m01, m02, m12 = p0 * q1 - p1 * q0, p0 * q2 - p2 * q0, p1 * q2 - p2 * q1
        sharp = m01 * m01 + m02 * m02 + m12 * m12
        scratch[i + XX], scratch[i + XY], scratch[i + YY] = xx + LOW_PASS, xy, yy + LOW_PASS
        scratch[i + DET_SHARP] = sharp
        scratch[i + DET] = sharp + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS
        scratch[i + OUT[MEAN_X]] = lens[0] * (x / z) + lens[2]
        scratch[i + OUT[MEAN_Y]] = lens[1] * (y / z) + lens[3]
        scratch[i + OUT[DEPTH]] = depth


@njit(cache=True, error_model="numpy", fastmath=CONTRACT)
def outline_block(scratch, count, lens):
    """Fill the block's columns of falloff and outline from its covariances; EXTENT_X = 0 marks the invisible.

    alpha >= 1/255 inside the ellipse (u dx + v dy)^2 + (w dy)^2 <= reach = 2 ln(255 opacity).
    """
    for i in range(np.uint64(count)):
        xx, xy, yy, det = scratch[i + XX], scratch[i + XY], scratch[i + YY], scratch[i + DET]
        reach = max(2 * (scratch[i + LOG_O] - math.log(SMALLEST_ALPHA)), 0.0)
        extent_x, extent_y = math.sqrt(reach * xx), math.sqrt(reach * yy)
        u, v = scratch[i + OUT[MEAN_X]], scratch[i + OUT[MEAN_Y]]
        seen = (scratch[i + OUT[DEPTH]] > NEAR) & (u + extent_x > 0) & (u - extent_x < lens[4])
        seen = seen & (v + extent_y > 0) & (v - extent_y < lens[5])
        width = 1 / math.sqrt(yy)
        root = math.sqrt(det)
        scratch[i + OUT[ROOT_U]], scratch[i + OUT[ROOT_V]] = 1 / (root * width), -xy * width / root
        scratch[i + OUT[ROOT_W]] = width
        scratch[i + OUT[LOG_OPACITY]] = scratch[i + LOG_O]
        scratch[i + OUT[EXTENT_X]] = extent_x if seen else 0.0
        scratch[i + OUT[EXTENT_Y]] = extent_y
        scratch[i + OUT[SLOPE]] = xy / xx
        scratch[i + OUT[HALF_CHORD]] = root / xx * extent_x
        scratch[i + OUT[TOP_X]] = xy * width * width * extent_y


@njit(cache=True, error_model="numpy")
def dim_block(scratch, count):
    """Take the opacity that the low-pass adds off again."""
    for i in range(count):
        scratch[i + 10 * BLOCK] += 0.5 * math.log(scratch[i + 15 * BLOCK] / scratch[i + 14 * BLOCK])


@njit(nogil=True, cache=True, error_model="numpy", fastmath=CONTRACT)
def mark_in_view(first_task, last_task, centers, log_scales, camera_from_world, intrinsics, marks):
    """Mark (splat,) what `project` can find visible, by bounds: the largest scale all round, and opacity 1."""
    pose, lens = pose_numbers(camera_from_world), lens_numbers(intrinsics)
    reach = -2 * math.log(SMALLEST_ALPHA)
    for s in range(first_task * BLOCK, min(last_task * BLOCK, len(centers))):
        x, y, z = camera_point(centers[s, 0], centers[s, 1], centers[s, 2], pose)
        if z <= NEAR:
            marks[s] = False
            continue
        largest = math.exp(2 * max(log_scales[s, 0], log_scales[s, 1], log_scales[s, 2]))
        slope_x, slope_y = min(max(x / z, lens[6]), lens[7]), min(max(y / z, lens[8]), lens[9])
        u, v = lens[0] * (x / z) + lens[2], lens[1] * (y / z) + lens[3]
        pace_x, pace_y = lens[0] / z, lens[1] / z
        extent_x = math.sqrt(reach * (largest * pace_x * pace_x * (1 + slope_x * slope_x) + LOW_PASS)) + BOUND_MARGIN
        extent_y = math.sqrt(reach * (largest * pace_y * pace_y * (1 + slope_y * slope_y) + LOW_PASS)) + BOUND_MARGIN
        across, down = abs(u - 0.5 * lens[4]) - 0.5 * lens[4], abs(v - 0.5 * lens[5]) - 0.5 * lens[5]
        marks[s] = across < extent_x and down < extent_y


@njit(nogil=True, cache=True, error_model="numpy")
def project(
    first_task, last_task, centers, rotations, scales, opacities, camera_from_world, intrinsics, antialiased, screen
):
    """Write the rows (splat, SCREEN_COLUMNS) of blocks of splats; EXTENT_X = 0 marks a splat as not visible."""
    pose, lens = pose_numbers(camera_from_world), lens_numbers(intrinsics)
    scratch = np.zeros(SCRATCH)
    for block in range(first_task, last_task):
        start = block * BLOCK
        count = min(BLOCK, len(centers) - start)
        load_splats(scratch, start, count, centers, rotations, scales, opacities)
        project_block(scratch, count, pose, lens)
        if antialiased:
            dim_block(scratch, count)
        outline_block(scratch, count, lens)
        for i in range(count):
            for column in range(SCREEN_COLUMNS):
                screen[start + i, column] = scratch[i + (16 + column) * BLOCK]
