"""Splats carried by particles, compiled for the CPU.

The same law as `slideframe.coupling.Coupling.at`, its float64 arbiter, with three short cuts: a particle
whose bits are those of the frame before is passed over, a splat outside the picture keeps its old shape,
and a deformation within the bounds of stretch needs no singular values. Tasks share no sums, so results
are the same bits for any number of threads.
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
def within_bounds(F):
    """Tell whether every singular value of F lies between the bounds, and F is not inverted."""
    low, high = LEAST_STRETCH**2 * (1 - STRETCH_ROUNDING), MOST_STRETCH**2 * (1 + STRETCH_ROUNDING)
    a = F[0, 0] * F[0, 0] + F[1, 0] * F[1, 0] + F[2, 0] * F[2, 0]
    b = F[0, 1] * F[0, 1] + F[1, 1] * F[1, 1] + F[2, 1] * F[2, 1]
    c = F[0, 2] * F[0, 2] + F[1, 2] * F[1, 2] + F[2, 2] * F[2, 2]
    d = F[0, 0] * F[0, 1] + F[1, 0] * F[1, 1] + F[2, 0] * F[2, 1]
    e = F[0, 0] * F[0, 2] + F[1, 0] * F[1, 2] + F[2, 0] * F[2, 2]
    f = F[0, 1] * F[0, 2] + F[1, 1] * F[1, 2] + F[2, 1] * F[2, 2]
    upright = (
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    ) > 0
    return (
        upright
        and positive_definite(a - low, b - low, c - low, d, e, f)
        and positive_definite(high - a, high - b, high - c, -d, -e, -f)
    )


@njit(cache=True, error_model="numpy")
def polar_rotation(F, R):
    """Write the rotation R of F = R U, by Newton's iteration X <- (X + X^-T) / 2 (Higham 1986)."""
    for i in range(3):
        for j in range(3):
            R[i, j] = F[i, j]
    cofactors = np.empty((3, 3))
    for _ in range(POLAR_STEPS):
        for i in range(3):
            for j in range(3):
                k, m, n, o = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                cofactors[i, j] = R[k, n] * R[m, o] - R[k, o] * R[m, n]
        determinant = R[0, 0] * cofactors[0, 0] + R[0, 1] * cofactors[0, 1] + R[0, 2] * cofactors[0, 2]
        for i in range(3):
            for j in range(3):
                R[i, j] = 0.5 * (R[i, j] + cofactors[i, j] / determinant)


@njit(nogil=True, cache=True, error_model="numpy")
def follow_particles(
    first_task, last_task, positions, gradients, particles, start, turns,
    last_positions, last_gradients, held, rotations, states, at_rest,
):  # fmt: skip
    """Fill `states` (carrier,), and F and its rotation of those that moved, float64 (carrier, 3, 3).

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
        elif within_bounds(held[k]):
            states[k] = MOVED
            if turns[k]:
                polar_rotation(held[k], rotations[k])
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
        for i in range(3):
            if at_rest[k]:
                centers[s, i] = rest_centers[s, i]
            else:
                centers[s, i] = positions[k, i] + (
                    held[k, i, 0] * offsets[row, 0] + held[k, i, 1] * offsets[row, 1] + held[k, i, 2] * offsets[row, 2]
                )


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
def can_touch(center, radius, opacity, camera_from_world, intrinsics):
    """Tell whether a splat can touch the picture; `radius` bounds its standard deviations, m.

    On the screen a standard deviation is at most focal / z sqrt(1 + slope^2) times as long.
    """
    V = camera_from_world
    focal_x, focal_y, principal_x, principal_y, width, height = intrinsics
    x, y, z = float(center[0]), float(center[1]), float(center[2])
    depth = V[2, 0] * x + V[2, 1] * y + V[2, 2] * z + V[2, 3]
    if not (depth > 0 and opacity > SMALLEST_ALPHA):
        return False
    slope_x = (V[0, 0] * x + V[0, 1] * y + V[0, 2] * z + V[0, 3]) / depth
    slope_y = (V[1, 0] * x + V[1, 1] * y + V[1, 2] * z + V[1, 3]) / depth
    spread = (radius / depth) ** 2
    u, v = focal_x * slope_x + principal_x, focal_y * slope_y + principal_y
    beyond_x, beyond_y = max(-u, u - width, 0.0), max(-v, v - height, 0.0)
    return beyond_x * beyond_x <= MOST_REACH * (
        spread * focal_x * focal_x * (1 + slope_x * slope_x) + LOW_PASS
    ) and beyond_y * beyond_y <= MOST_REACH * (spread * focal_y * focal_y * (1 + slope_y * slope_y) + LOW_PASS)
