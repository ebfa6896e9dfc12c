"""Colours of splats from spherical harmonics to degree 3, and their gradient, compiled for the CPU.

Signs and order are those of Kerbl et al. 2023; `harmonics` has the same in torch. A task is a block of splats.
"""

import math

import numpy as np
from numba import njit

from slideframe_gs_torch import harmonics
from slideframe_gs_torch.projection_kernels import BLOCK, EXTENT_X

C0, C1 = harmonics.C0, harmonics.C1
XY, Z2, X2Y2 = harmonics.XY, harmonics.Z2, harmonics.X2Y2
X3, XYZ, XZ2, Z3, X2Y2Z = harmonics.X3, harmonics.XYZ, harmonics.XZ2, harmonics.Z3, harmonics.X2Y2Z


@njit(cache=True, error_model="numpy")
def write_basis(x, y, z, count, basis):
    """Write the first `count` (1, 4, 9 or 16) functions at a unit direction into `basis`."""
    basis[0] = C0
    if count > 1:
        basis[1], basis[2], basis[3] = -C1 * y, C1 * z, -C1 * x
    if count > 4:
        basis[4], basis[5], basis[6] = XY * x * y, -XY * y * z, Z2 * (2 * z * z - x * x - y * y)
        basis[7], basis[8] = -XY * x * z, X2Y2 * (x * x - y * y)
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        basis[9], basis[10] = -X3 * y * (3 * xx - yy), XYZ * x * y * z
        basis[11], basis[12] = -XZ2 * y * (4 * zz - xx - yy), Z3 * z * (2 * zz - 3 * xx - 3 * yy)
        basis[13], basis[14] = -XZ2 * x * (4 * zz - xx - yy), X2Y2Z * z * (xx - yy)
        basis[15] = -X3 * x * (xx - 3 * yy)


@njit(cache=True, error_model="numpy")
def slope_along(x, y, z, count, by):
    """Return the gradient, by direction (x, y, z), of the sum of basis functions weighted with `by` (count,)."""
    g_x = g_y = g_z = 0.0
    if count > 1:
        g_x, g_y, g_z = -C1 * by[3], -C1 * by[1], C1 * by[2]
    if count > 4:
        g_x += XY * (y * by[4] - z * by[7]) - 2 * Z2 * x * by[6] + 2 * X2Y2 * x * by[8]
        g_y += XY * (x * by[4] - z * by[5]) - 2 * Z2 * y * by[6] - 2 * X2Y2 * y * by[8]
        g_z += -XY * (y * by[5] + x * by[7]) + 4 * Z2 * z * by[6]
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        g_x += -6 * X3 * x * y * by[9] + XYZ * y * z * by[10] + 2 * XZ2 * x * y * by[11] - 6 * Z3 * x * z * by[12]
        g_x += -XZ2 * (4 * zz - 3 * xx - yy) * by[13] + 2 * X2Y2Z * x * z * by[14] - 3 * X3 * (xx - yy) * by[15]
        g_y += -3 * X3 * (xx - yy) * by[9] + XYZ * x * z * by[10] - XZ2 * (4 * zz - xx - 3 * yy) * by[11]
        g_y += (
            -6 * Z3 * y * z * by[12] + 2 * XZ2 * x * y * by[13] - 2 * X2Y2Z * y * z * by[14] + 6 * X3 * x * y * by[15]
        )
        g_z += XYZ * x * y * by[10] - 8 * XZ2 * y * z * by[11] + Z3 * (6 * zz - 3 * xx - 3 * yy) * by[12]
        g_z += -8 * XZ2 * x * z * by[13] + X2Y2Z * (xx - yy) * by[14]
    return g_x, g_y, g_z


@njit(cache=True, error_model="numpy")
def unit_direction(center, viewpoint, frame):
    """Return the unit vector from the viewpoint to a splat, in the splat's frame (0 or 3, 3), and their distance."""
    x, y, z = center[0] - viewpoint[0], center[1] - viewpoint[1], center[2] - viewpoint[2]
    distance = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    x, y, z = x / distance, y / distance, z / distance
    if len(frame):
        x, y, z = (
            frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
            frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
            frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
        )
    return x, y, z, distance


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def paint(first_task, last_task, centers, coefficients, viewpoint, frames, screen, colours):
    """Write the colours (splat, 3) of visible splats seen from `viewpoint` (3,): 0.5 + basis . coefficients, >= 0.

    `coefficients` are (splat, 1, 4, 9 or 16, 3); `frames` (splat, 3, 3) or (1, 0, 0) for none; visibility stands in
    `screen` (splat, SCREEN_COLUMNS).
    """
    count = coefficients.shape[1]
    basis = np.empty(16)
    turned = len(frames) == len(centers) and frames.shape[1] == 3
    for s in range(first_task * BLOCK, min(last_task * BLOCK, len(centers))):
        if screen[s, EXTENT_X] > 0:
            x, y, z, _ = unit_direction(centers[s], viewpoint, frames[s if turned else 0])
            write_basis(x, y, z, count, basis)
            red = green = blue = 0.5
            for k in range(count):
                red += basis[k] * coefficients[s, k, 0]
                green += basis[k] * coefficients[s, k, 1]
                blue += basis[k] * coefficients[s, k, 2]
            colours[s, 0], colours[s, 1], colours[s, 2] = max(red, 0.0), max(green, 0.0), max(blue, 0.0)


@njit(nogil=True, cache=True, error_model="numpy")
def paint_backward(
    first_task, last_task, centers, coefficients, viewpoint, frames, colours, slot_counts, d_colours,
    d_coefficients, d_centers, d_viewpoints,
):  # fmt: skip
    """Write `d_coefficients`, add to `d_centers` (splat, 3), and write each block's `d_viewpoints` (block, 3)."""
    count = coefficients.shape[1]
    basis, by = np.empty(16), np.empty(16)
    turned = len(frames) == len(centers) and frames.shape[1] == 3
    for block in range(first_task, last_task):
        view_x = view_y = view_z = 0.0
        for s in range(block * BLOCK, min((block + 1) * BLOCK, len(centers))):
            if slot_counts[s] == 0:
                d_coefficients[s] = 0.0
                continue
            frame = frames[s if turned else 0]
            x, y, z, distance = unit_direction(centers[s], viewpoint, frame)
            write_basis(x, y, z, count, basis)
            red = d_colours[s, 0] if colours[s, 0] > 0 else np.float32(0.0)
            green = d_colours[s, 1] if colours[s, 1] > 0 else np.float32(0.0)
            blue = d_colours[s, 2] if colours[s, 2] > 0 else np.float32(0.0)
            for k in range(count):
                by[k] = coefficients[s, k, 0] * red + coefficients[s, k, 1] * green + coefficients[s, k, 2] * blue
                d_coefficients[s, k, 0] = basis[k] * red
                d_coefficients[s, k, 1] = basis[k] * green
                d_coefficients[s, k, 2] = basis[k] * blue
            g_x, g_y, g_z = slope_along(x, y, z, count, by)
            along = g_x * x + g_y * y + g_z * z
            g_x, g_y, g_z = (g_x - along * x) / distance, (g_y - along * y) / distance, (g_z - along * z) / distance
            if turned:
                g_x, g_y, g_z = (
                    frame[0, 0] * g_x + frame[0, 1] * g_y + frame[0, 2] * g_z,
                    frame[1, 0] * g_x + frame[1, 1] * g_y + frame[1, 2] * g_z,
                    frame[2, 0] * g_x + frame[2, 1] * g_y + frame[2, 2] * g_z,
                )
            d_centers[s, 0] += g_x
            d_centers[s, 1] += g_y
            d_centers[s, 2] += g_z
            view_x, view_y, view_z = view_x - g_x, view_y - g_y, view_z - g_z
        d_viewpoints[block, 0], d_viewpoints[block, 1], d_viewpoints[block, 2] = view_x, view_y, view_z
