"""Splats carried by particles, compiled for the CPU.

The same law as `slideframe.coupling.Coupling.at`, its float64 arbiter, with three short cuts: a particle
whose bits are those of the frame before is passed over, a splat outside the picture keeps its old shape,
and a deformation within the bounds of stretch needs no singular values. Tasks share no sums, so results
are the same bits for any number of threads.

Functions take a whole array and an index: a slice of it counts its references in an atomic that all threads
share, which took longer than the arithmetic.
"""

import math

import numpy as np
from numba import njit

from slideframe.coupling import LEAST_STRETCH, MOST_STRETCH

# What became of a particle since the frame before.
UNCHANGED, AT_REST, MOVED, OUT_OF_BOUNDS = range(4)

# Fainter splats leave no trace in 8 bits (Kerbl et al. 2023).
SMALLEST_ALPHA = 1.0 / 255.0
# Square of the number of standard deviations beyond which an opaque splat is that faint.
MOST_REACH = 2 * math.log(1 / SMALLEST_ALPHA)
# Low-pass that the rasteriser adds to every splat on the screen, px^2, and a little for its rounding.
LOW_PASS = 0.4
# Solvers hold the stretch in float32: its rounding is no reason to hold it again.
STRETCH_ROUNDING = 1e-5
# A polar decomposition within the bounds of stretch converges to float64 in five steps.
POLAR_STEPS = 6


@njit(cache=True, error_model="numpy")
def positive_definite(a, b, c, d, e, f):
    """Tell whether [[a, d, e], [d, b, f], [e, f, c]] is, by its leading minors."""
    minor = a * b - d * d
    return a > 0 and minor > 0 and c * minor - a * f * f - b * e * e + 2 * d * e * f > 0


@njit(cache=True, error_model="numpy")
def within_bounds(F, k):
    """Tell whether every singular value of F[k] lies between the bounds, and F[k] is not inverted."""
    low, high = LEAST_STRETCH**2 * (1 - STRETCH_ROUNDING), MOST_STRETCH**2 * (1 + STRETCH_ROUNDING)
    xx, xy, xz = np.float64(F[k, 0, 0]), np.float64(F[k, 0, 1]), np.float64(F[k, 0, 2])
    yx, yy, yz = np.float64(F[k, 1, 0]), np.float64(F[k, 1, 1]), np.float64(F[k, 1, 2])
    zx, zy, zz = np.float64(F[k, 2, 0]), np.float64(F[k, 2, 1]), np.float64(F[k, 2, 2])
    a, b, c = xx * xx + yx * yx + zx * zx, xy * xy + yy * yy + zy * zy, xz * xz + yz * yz + zz * zz
    d, e, f = xx * xy + yx * yy + zx * zy, xx * xz + yx * yz + zx * zz, xy * xz + yy * yz + zy * zz
    upright = xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx) > 0
    return (
        upright
        and positive_definite(a - low, b - low, c - low, d, e, f)
        and positive_definite(high - a, high - b, high - c, -d, -e, -f)
    )


@njit(cache=True, error_model="numpy")
def polar_rotation(F, k, R):
    """Write the rotation R[k] of F[k] = R U, by Newton's iteration X <- (X + X^-T) / 2 (Higham 1986)."""
    xx, xy, xz = np.float64(F[k, 0, 0]), np.float64(F[k, 0, 1]), np.float64(F[k, 0, 2])
    yx, yy, yz = np.float64(F[k, 1, 0]), np.float64(F[k, 1, 1]), np.float64(F[k, 1, 2])
    zx, zy, zz = np.float64(F[k, 2, 0]), np.float64(F[k, 2, 1]), np.float64(F[k, 2, 2])
    for _ in range(POLAR_STEPS):
        # X^-T are the cofactors over the determinant
        a, b, c = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx
        d, e, f = xz * zy - xy * zz, xx * zz - xz * zx, xy * zx - xx * zy
        g, h, i = xy * yz - xz * yy, xz * yx - xx * yz, xx * yy - xy * yx
        half = 0.5 / (xx * a + xy * b + xz * c)
        xx, xy, xz = 0.5 * xx + half * a, 0.5 * xy + half * b, 0.5 * xz + half * c
        yx, yy, yz = 0.5 * yx + half * d, 0.5 * yy + half * e, 0.5 * yz + half * f
        zx, zy, zz = 0.5 * zx + half * g, 0.5 * zy + half * h, 0.5 * zz + half * i
    R[k, 0, 0], R[k, 0, 1], R[k, 0, 2] = xx, xy, xz
    R[k, 1, 0], R[k, 1, 1], R[k, 1, 2] = yx, yy, yz
    R[k, 2, 0], R[k, 2, 1], R[k, 2, 2] = zx, zy, zz


@njit(nogil=True, cache=True, error_model="numpy")
def follow_particles(
    first_task, last_task, positions, gradients, particles, start, turns,
    last_positions, last_gradients, held, rotations, states, at_rest,
):  # fmt: skip
    """Fill `states` (carrier,), and F and its rotation of those that moved (carrier, 3, 3).

    `particles` are the carriers' places in the frame, `start` their positions at t = 0, `turns` whether
    their rotation is asked for; `at_rest` outlasts the frames in which nothing changes. An F out of bounds
    is left for `clamp_stretch`.
    """
    for k in range(first_task, last_task):
        p = particles[k]
        same, rest = True, True
        for i in range(3):
            same &= positions[p, i] == last_positions[k, i]
            rest &= positions[p, i] == start[k, i]
            last_positions[k, i] = positions[p, i]
            for j in range(3):
                same &= gradients[p, i, j] == last_gradients[k, i, j]
                rest &= gradients[p, i, j] == (1.0 if i == j else 0.0)
                last_gradients[k, i, j] = gradients[p, i, j]
        if same:
            states[k] = UNCHANGED
            continue
        at_rest[k] = rest
        for i in range(3):
            for j in range(3):
                held[k, i, j] = gradients[p, i, j]
        if rest:
            states[k] = AT_REST
        elif within_bounds(held, k):
            states[k] = MOVED
            if turns[k]:
                polar_rotation(held, k, rotations)
        else:
            states[k] = OUT_OF_BOUNDS


@njit(nogil=True, cache=True, error_model="numpy")
def move_centers(
    first_task, last_task, moving, carriers, states, at_rest, positions, held, offsets, rest_centers, centers, stale
):
    """Move the splats of particles that moved, x = x_p + F (X - X_p), and mark their shapes as `stale`.

    `moving` (row,) are the splats that follow a particle, `carriers` (row,) which.
    """
    for row in range(first_task, last_task):
        k, s = carriers[row], moving[row]
        if states[k] == UNCHANGED:
            continue
        stale[row] = True
        x, y, z = np.float64(offsets[row, 0]), np.float64(offsets[row, 1]), np.float64(offsets[row, 2])
        for i in range(3):
            if at_rest[k]:
                centers[s, i] = rest_centers[s, i]
            else:
                centers[s, i] = positions[k, i] + (held[k, i, 0] * x + held[k, i, 1] * y + held[k, i, 2] * z)


@njit(nogil=True, cache=True, error_model="numpy")
def unveil(first_task, last_task, veiled, veils, states, positions, start, widths, rest_opacities, opacities):
    """Set the opacity of splats that lie hidden until their particle has gone its own width."""
    for row in range(first_task, last_task):
        k, s = veils[row], veiled[row]
        if states[k] == UNCHANGED:
            continue
        square = 0.0
        for i in range(3):
            square += (positions[k, i] - start[k, i]) ** 2
        opacities[s] = rest_opacities[s] * min(math.sqrt(square) / widths[k], 1.0)


@njit(cache=True, error_model="numpy")
def can_touch(centers, s, radius, opacity, V, intrinsics):
    """Tell whether splat s can touch the picture; `radius` bounds its standard deviations, m,
    and `V` (3, 4) is the camera from the world.

    On the screen a standard deviation is at most focal / z sqrt(1 + slope^2) times as long.
    """
    x, y, z = np.float64(centers[s, 0]), np.float64(centers[s, 1]), np.float64(centers[s, 2])
    depth = V[2, 0] * x + V[2, 1] * y + V[2, 2] * z + V[2, 3]
    if not (depth > 0 and opacity > SMALLEST_ALPHA):
        return False
    focal_x, focal_y, width, height = intrinsics[0], intrinsics[1], intrinsics[4], intrinsics[5]
    nearness = 1 / depth
    slope_x = (V[0, 0] * x + V[0, 1] * y + V[0, 2] * z + V[0, 3]) * nearness
    slope_y = (V[1, 0] * x + V[1, 1] * y + V[1, 2] * z + V[1, 3]) * nearness
    spread = (radius * nearness) ** 2
    u, v = focal_x * slope_x + intrinsics[2], focal_y * slope_y + intrinsics[3]
    beyond_x, beyond_y = max(-u, u - width, 0.0), max(-v, v - height, 0.0)
    return beyond_x * beyond_x <= MOST_REACH * (
        spread * focal_x * focal_x * (1 + slope_x * slope_x) + LOW_PASS
    ) and beyond_y * beyond_y <= MOST_REACH * (spread * focal_y * focal_y * (1 + slope_y * slope_y) + LOW_PASS)
