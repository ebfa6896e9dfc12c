"""The grid between the transfers: forces become velocities, and walls act on them."""

import taichi as ti

from slideframe.problem.boundary import IS_OPEN, STICKS

from .arrays import Array
from .layout import Pair, place_of


@ti.func
def contact(velocity, normal, coefficient):
    """Return a node's velocity after one-sided contact with a surface: no penetration, Coulomb's friction.

    `coefficient` is that of slideframe's Wall: Coulomb's, or STICKS or IS_OPEN.
    """
    result = velocity
    approach = -velocity.dot(normal)
    if coefficient == STICKS:
        result = ti.Vector([0.0, 0.0, 0.0])
    elif coefficient != IS_OPEN and approach > 0.0:
        result = velocity + approach * normal
        if coefficient > 0.0:
            speed = result.norm()
            # the impulse that stops the approach bounds that of friction (Coulomb)
            if speed <= coefficient * approach:
                result = ti.Vector([0.0, 0.0, 0.0])
            else:
                result *= 1.0 - coefficient * approach / speed
    return result


@ti.func
def ground(velocity, i, j, k, solid: ti.template(), normals: ti.template()):
    """Return a node's velocity after contact with the solid ground, where the node lies in it (ContactNodes)."""
    result = velocity
    if i < solid.shape[0] and j < solid.shape[1]:
        layer = k - solid[i, j][0]
        if layer >= 0 and layer < solid[i, j][1]:
            normal = normals[solid[i, j][2] + layer]
            result = contact(velocity, ti.Vector([normal[0], normal[1], normal[2]]), normal[3])
    return result


@ti.func
def walls(velocity, i, j, k, padding, high, side, floor):
    """Return a node's velocity after contact with the walls of the box, of coefficients `side` and `floor`."""
    result = velocity
    if i <= padding:
        result = contact(result, ti.Vector([1.0, 0.0, 0.0]), side)
    if i >= high[0]:
        result = contact(result, ti.Vector([-1.0, 0.0, 0.0]), side)
    if j <= padding:
        result = contact(result, ti.Vector([0.0, 1.0, 0.0]), side)
    if j >= high[1]:
        result = contact(result, ti.Vector([0.0, -1.0, 0.0]), side)
    if k <= padding:
        result = contact(result, ti.Vector([0.0, 0.0, 1.0]), floor)
    return result


@ti.kernel
def clear_grid(grid: Array, forces: Array, node_count: ti.i32, keeps_excess: ti.template()):
    """Take momentum and mass, and what else it is given, off every node."""
    for node in range(node_count):
        grid[node] = ti.Vector([0.0, 0.0, 0.0, 0.0])
        if ti.static(keeps_excess):
            forces[node] = ti.Vector([0.0, 0.0, 0.0, 0.0])


@ti.kernel
def update_grid(
    grid: Array,
    node_count: ti.i32,
    columns: Array,
    owners: Array,
    corner: Pair,
    across: ti.i32,
    forces: Array,
    keeps_excess: ti.template(),
    gravity: Array,
    time_step: float,
    kept: float,
    solid: Array,
    normals: Array,
    padding: ti.i32,
    high: ti.types.vector(2, ti.i32),
    side: float,
    floor: float,
):
    """Turn momentum into velocity, apply gravity and damping (`kept` is what that leaves), then ground and walls.

    Where particles keep an excess, the impulses of stress come in `forces`, which leave with the velocity before them.
    """
    for node in range(node_count):
        entry = grid[node]
        if entry[3] > 0.0:
            i, j, k = place_of(node, columns, owners, corner, across)
            # not `v` yet: Taichi 1.7.4 loses what a vector is set to after it has been stored
            before = ti.Vector([entry[0], entry[1], entry[2]]) / entry[3]
            change = time_step * gravity[0]
            if ti.static(keeps_excess):
                impulse = forces[node]
                change += ti.Vector([impulse[0], impulse[1], impulse[2]]) / entry[3]
                forces[node] = ti.Vector([before[0], before[1], before[2], 0.0])
            v = kept * (before + change)
            v = ground(v, i, j, k, solid, normals)
            v = walls(v, i, j, k, padding, high, side, floor)
            grid[node] = ti.Vector([v[0], v[1], v[2], entry[3]])
