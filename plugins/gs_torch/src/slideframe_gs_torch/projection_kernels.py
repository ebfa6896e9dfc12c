"""Elliptical weighted average projection of splats and its gradient, compiled for the CPU.

A task is one splat; arithmetic inside a splat is float64, because it is cheap there and the
conic of a needle is badly conditioned. Formulas: Zwicker et al. 2002 (EWA splatting); the low-pass of
0.3 px^2, the widened frustum of the Jacobian and the thresholds are those of Kerbl et al. 2023.
"""

import math

import numpy as np
from numba import njit

# Columns of the projected splat. Extents are half sizes of the box, in px, beyond which alpha < 1/255.
# The falloff is exp(-((u dx + v dy)^2 + (w dy)^2) / 2), with a Cholesky factor L of the conic K = L^T L, since
# the conic itself loses a needle's width to cancellation in float32.
MEAN_X, MEAN_Y, ROOT_U, ROOT_V, ROOT_W, EXTENT_X, EXTENT_Y, OPACITY, RED, GREEN, BLUE, DEPTH = range(12)
SCREEN_COLUMNS = 12

# Columns of the gradient gathered from the pixels: moments of dL/dpower in units of sigma (1, t, s, tt, ts, ss
# with t = u dx + v dy and s = w dy), then weighted pixel gradients (red, green, blue, depth).
MOMENT_COLUMNS = 10

LOW_PASS = 0.3
NEAR = 0.2
SMALLEST_ALPHA = 1.0 / 255.0
FRUSTUM_MARGIN = 0.3


@njit(cache=True, error_model="numpy")
def rotation_matrix(w, x, y, z):
    """Return the rotation of a unit quaternion, row by row."""
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def camera_point(center, camera_from_world):
    """Return the splat's centre in camera axes."""
    V = camera_from_world
    x = V[0, 0] * center[0] + V[0, 1] * center[1] + V[0, 2] * center[2] + V[0, 3]
    y = V[1, 0] * center[0] + V[1, 1] * center[1] + V[1, 2] * center[2] + V[1, 3]
    z = V[2, 0] * center[0] + V[2, 1] * center[1] + V[2, 2] * center[2] + V[2, 3]
    return x, y, z


@njit(cache=True, error_model="numpy")
def slope_limits(intrinsics):
    """Return the lowest and highest x/z and y/z at which the projection's Jacobian is taken."""
    focal_x, focal_y, principal_x, principal_y, width, height = intrinsics
    margin_x, margin_y = FRUSTUM_MARGIN * width / (2 * focal_x), FRUSTUM_MARGIN * height / (2 * focal_y)
    return (
        -principal_x / focal_x - margin_x, (width - principal_x) / focal_x + margin_x,
        -principal_y / focal_y - margin_y, (height - principal_y) / focal_y + margin_y,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def stretched_axes(rotation, scale):
    """Return the unit quaternion, its length before, and M = R S (3, 3), whose M M^T is the covariance."""
    w, x, y, z = float(rotation[0]), float(rotation[1]), float(rotation[2]), float(rotation[3])
    length = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    R = rotation_matrix(w, x, y, z)
    axes = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            axes[i, j] = R[3 * i + j] * scale[j]
    return (w, x, y, z), length, axes


@njit(cache=True, error_model="numpy")
def projected_axes(point, axes, intrinsics, limits, camera_from_world):
    """Return J W (2, 3) and P = J W M (2, 3), whose P P^T is the covariance on the screen, px^2."""
    x, y, z = point
    slope_x, slope_y = min(max(x / z, limits[0]), limits[1]), min(max(y / z, limits[2]), limits[3])
    focal_x, focal_y = intrinsics[0], intrinsics[1]
    turned = np.empty((2, 3))
    projected = np.empty((2, 3))
    for j in range(3):
        turned[0, j] = focal_x / z * (camera_from_world[0, j] - slope_x * camera_from_world[2, j])
        turned[1, j] = focal_y / z * (camera_from_world[1, j] - slope_y * camera_from_world[2, j])
    for i in range(2):
        for j in range(3):
            projected[i, j] = turned[i, 0] * axes[0, j] + turned[i, 1] * axes[1, j] + turned[i, 2] * axes[2, j]
    return turned, projected


@njit(cache=True, error_model="numpy")
def conic_of(splat):
    """Return a, b, c of the projected splat's inverse covariance, 1/px^2."""
    u, v, w = float(splat[ROOT_U]), float(splat[ROOT_V]), float(splat[ROOT_W])
    return u * u, u * v, v * v + w * w


@njit(cache=True, error_model="numpy")
def screen_covariance(projected):
    """Return xx, xy, yy of P P^T with the low-pass added, px^2."""
    xx = yy = LOW_PASS
    xy = 0.0
    for j in range(3):
        xx += projected[0, j] * projected[0, j]
        xy += projected[0, j] * projected[1, j]
        yy += projected[1, j] * projected[1, j]
    return xx, xy, yy


@njit(nogil=True, cache=True, error_model="numpy")
def project(
    first_task, last_task, centers, rotations, scales, opacities, colours, camera_from_world, intrinsics, screen
):
    """Fill `screen` (splat, SCREEN_COLUMNS); a splat that can't be seen gets an extent of 0."""
    limits = slope_limits(intrinsics)
    focal_x, focal_y, principal_x, principal_y, width, height = intrinsics
    for s in range(first_task, last_task):
        screen[s, EXTENT_X] = 0.0
        point = camera_point(centers[s], camera_from_world)
        x, y, z = point
        if not (z > NEAR and opacities[s] > SMALLEST_ALPHA):
            continue
        _, _, axes = stretched_axes(rotations[s], scales[s])
        _, projected = projected_axes(point, axes, intrinsics, limits, camera_from_world)
        xx, xy, yy = screen_covariance(projected)
        determinant = xx * yy - xy * xy
        u, v = focal_x * x / z + principal_x, focal_y * y / z + principal_y
        # alpha = o exp(-q/2) >= 1/255 inside the ellipse q <= 2 ln(255 o)
        reach = 2 * math.log(opacities[s] / SMALLEST_ALPHA)
        extent_x, extent_y = math.sqrt(reach * xx), math.sqrt(reach * yy)
        seen = u + extent_x > 0 and u - extent_x < width and v + extent_y > 0 and v - extent_y < height
        if not (seen and determinant > 0):
            continue
        screen[s, MEAN_X], screen[s, MEAN_Y] = u, v
        root = math.sqrt(yy / determinant)
        screen[s, ROOT_U], screen[s, ROOT_V], screen[s, ROOT_W] = root, -xy / determinant / root, 1 / math.sqrt(yy)
        screen[s, EXTENT_X], screen[s, EXTENT_Y] = extent_x, extent_y
        screen[s, OPACITY], screen[s, DEPTH] = opacities[s], z
        screen[s, RED], screen[s, GREEN], screen[s, BLUE] = colours[s, 0], colours[s, 1], colours[s, 2]


@njit(cache=True, error_model="numpy")
def gather_moments(moments, start, stop, total):
    """Sum the gradients of one splat over its tiles, in their order."""
    total[:] = 0.0
    for k in range(start, stop):
        for column in range(MOMENT_COLUMNS):
            total[column] += moments[k, column]


@njit(cache=True, error_model="numpy")
def covariance_gradient(u, v, w, total):
    """Return dL/dSigma (symmetric: xx, xy, yy) = L^T M L / 2, with M the second moments in units of sigma."""
    m_tt, m_ts, m_ss = total[3], total[4], total[5]
    g_xy = u * (v * m_tt + w * m_ts)
    return 0.5 * u * u * m_tt, 0.5 * g_xy, 0.5 * (v * v * m_tt + 2 * v * w * m_ts + w * w * m_ss)


@njit(cache=True, error_model="numpy")
def quaternion_gradient(quaternion, length, g):
    """Return dL/d(raw quaternion) from g = dL/dR (3, 3), through the normalisation."""
    w, x, y, z = quaternion
    d_w = 2 * (x * (g[2, 1] - g[1, 2]) + y * (g[0, 2] - g[2, 0]) + z * (g[1, 0] - g[0, 1]))
    d_x = 2 * (
        w * (g[2, 1] - g[1, 2]) - 2 * x * (g[1, 1] + g[2, 2]) + y * (g[0, 1] + g[1, 0]) + z * (g[0, 2] + g[2, 0])
    )
    d_y = 2 * (
        w * (g[0, 2] - g[2, 0]) + x * (g[0, 1] + g[1, 0]) - 2 * y * (g[0, 0] + g[2, 2]) + z * (g[1, 2] + g[2, 1])
    )
    d_z = 2 * (
        w * (g[1, 0] - g[0, 1]) + x * (g[0, 2] + g[2, 0]) + y * (g[1, 2] + g[2, 1]) - 2 * z * (g[0, 0] + g[1, 1])
    )
    along = w * d_w + x * d_x + y * d_y + z * d_z
    return (
        (d_w - w * along) / length,
        (d_x - x * along) / length,
        (d_y - y * along) / length,
        (d_z - z * along) / length,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def project_backward(
    first_task, last_task, centers, rotations, scales, camera_from_world, intrinsics, screen,
    slot_starts, slot_counts, moments,
    d_centers, d_rotations, d_scales, d_opacities, d_colours, d_means,
):  # fmt: skip
    """Carry the pixels' moments back to the splats; every output is overwritten.

    `d_means` (splat, 2) receives the sum over tiles of |dL/dmean|, per px: cancellation inside a large
    splat must not hide that it covers too much (the reasoning of AbsGS, Ye et al. 2024).
    """
    limits = slope_limits(intrinsics)
    focal_x, focal_y = intrinsics[0], intrinsics[1]
    V = camera_from_world
    for s in range(first_task, last_task):
        start, stop = slot_starts[s], slot_starts[s] + slot_counts[s]
        if start == stop:
            d_centers[s], d_rotations[s], d_scales[s], d_opacities[s], d_colours[s], d_means[s] = 0, 0, 0, 0, 0, 0
            continue
        total = np.empty(MOMENT_COLUMNS)
        gather_moments(moments, start, stop, total)
        u, v, w = float(screen[s, ROOT_U]), float(screen[s, ROOT_V]), float(screen[s, ROOT_W])
        u_absolute = v_absolute = 0.0
        for k in range(start, stop):
            u_absolute += abs(u * moments[k, 1])
            v_absolute += abs(v * moments[k, 1] + w * moments[k, 2])
        d_means[s, 0], d_means[s, 1] = u_absolute, v_absolute
        d_u, d_v = u * total[1], v * total[1] + w * total[2]
        d_opacities[s] = total[0] / screen[s, OPACITY]
        d_colours[s, 0], d_colours[s, 1], d_colours[s, 2] = total[6], total[7], total[8]

        x, y, z = camera_point(centers[s], V)
        quaternion, length, axes = stretched_axes(rotations[s], scales[s])
        turned, projected = projected_axes((x, y, z), axes, intrinsics, limits, V)
        g_xx, g_xy, g_yy = covariance_gradient(u, v, w, total)
        d_projected = np.empty((2, 3))
        for j in range(3):
            d_projected[0, j] = 2 * (g_xx * projected[0, j] + g_xy * projected[1, j])
            d_projected[1, j] = 2 * (g_xy * projected[0, j] + g_yy * projected[1, j])

        # dL/dM = (J W)^T dL/dP, and M = R S
        d_rotation = np.empty((3, 3))
        R = rotation_matrix(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        for j in range(3):
            d_scale = 0.0
            for i in range(3):
                d_axis = turned[0, i] * d_projected[0, j] + turned[1, i] * d_projected[1, j]
                d_scale += d_axis * R[3 * i + j]
                d_rotation[i, j] = d_axis * scales[s, j]
            d_scales[s, j] = d_scale
        d_w, d_qx, d_qy, d_qz = quaternion_gradient(quaternion, length, d_rotation)
        d_rotations[s, 0], d_rotations[s, 1], d_rotations[s, 2], d_rotations[s, 3] = d_w, d_qx, d_qy, d_qz

        # dL/dJ = dL/dP M^T W^T; only J's four entries that depend on the point matter
        d_j00 = d_j02 = d_j11 = d_j12 = 0.0
        for i in range(3):
            row_x = d_projected[0, 0] * axes[i, 0] + d_projected[0, 1] * axes[i, 1] + d_projected[0, 2] * axes[i, 2]
            row_y = d_projected[1, 0] * axes[i, 0] + d_projected[1, 1] * axes[i, 1] + d_projected[1, 2] * axes[i, 2]
            d_j00 += row_x * V[0, i]
            d_j02 += row_x * V[2, i]
            d_j11 += row_y * V[1, i]
            d_j12 += row_y * V[2, i]
        slope_x, slope_y = x / z, y / z
        inside_x, inside_y = limits[0] < slope_x < limits[1], limits[2] < slope_y < limits[3]
        slope_x, slope_y = min(max(slope_x, limits[0]), limits[1]), min(max(slope_y, limits[2]), limits[3])
        pull_x, pull_y = focal_x / (z * z), focal_y / (z * z)
        d_x = d_u * focal_x / z - (d_j02 * pull_x if inside_x else 0.0)
        d_y = d_v * focal_y / z - (d_j12 * pull_y if inside_y else 0.0)
        d_z = total[9] - d_u * pull_x * x - d_v * pull_y * y - d_j00 * pull_x - d_j11 * pull_y
        d_z += d_j02 * pull_x * slope_x * (2.0 if inside_x else 1.0) + d_j12 * pull_y * slope_y * (
            2.0 if inside_y else 1.0
        )
        for j in range(3):
            d_centers[s, j] = V[0, j] * d_x + V[1, j] * d_y + V[2, j] * d_z
