"""The grid between the transfers: forces become velocities, and walls act on them."""

import taichi as ti

from .arrays import Array
from .layout import Pair, place_of

STICK = 1
FRICTION = 2


@ti.func
def wall(velocity, axis: ti.template(), inward: ti.template(), kind, friction):
    """Return a node's velocity after one-sided contact with a plane whose normal is `inward` along `axis`."""
    result = velocity
    approach = -inward * velocity[axis]
    if kind == STICK:
        result = ti.Vector([0.0, 0.0, 0.0])
    elif approach > 0.0:
        result[axis] = 0.0
        if kind == FRICTION:
            speed = result.norm()
            # the impulse that stops the approach bounds that of friction (Coulomb)
            if speed <= friction * approach:
                result = ti.Vector([0.0, 0.0, 0.0])
            else:
                result *= 1.0 - friction * approach / speed
    return result


@ti.kernel
def clear_grid(grid: Array, node_count: ti.i32):
    """Take momentum and mass off every node."""
    for node in range(node_count):
        grid[node] = ti.Vector([0.0, 0.0, 0.0, 0.0])


@ti.kernel
def update_grid(
    grid: Array,
    node_count: ti.i32,
    columns: Array,
    owners: Array,
    corner: Pair,
    across: ti.i32,
    gravity: Array,
    time_step: float,
    padding: ti.i32,
    high: ti.types.vector(2, ti.i32),
    wall_kinds: ti.types.vector(2, ti.i32),
    side_friction: float,
    floor_friction: float,
):
    """Turn momentum into velocity, apply gravity, then the walls; the kinds are of (sides, floor)."""
    for node in range(node_count):
        entry = grid[node]
        if entry[3] > 0.0:
            i, j, k = place_of(node, columns, owners, corner, across)
            v = ti.Vector([entry[0], entry[1], entry[2]]) / entry[3] + time_step * gravity[0]
            if i <= padding:
                v = wall(v, 0, 1.0, wall_kinds[0], side_friction)
            if i >= high[0]:
                v = wall(v, 0, -1.0, wall_kinds[0], side_friction)
            if j <= padding:
                v = wall(v, 1, 1.0, wall_kinds[0], side_friction)
            if j >= high[1]:
                v = wall(v, 1, -1.0, wall_kinds[0], side_friction)
            if k <= padding:
                v = wall(v, 2, 1.0, wall_kinds[1], floor_friction)
            grid[node] = ti.Vector([v[0], v[1], v[2], entry[3]])
