"""The grid between the transfers: forces become velocities, and walls act on them."""

import warp as wp

from slideframe.problem.boundary import IS_OPEN, STICKS

from .layout import place_of
from .reals import KEEPS_EXCESS, Real, Vector, Vector2, Vector4

wp.set_module_options({"enable_backward": False})

STICKS = wp.constant(Real(STICKS))
IS_OPEN = wp.constant(Real(IS_OPEN))


@wp.func
def contact(velocity: Vector, normal: Vector, coefficient: Real) -> Vector:
    """Return a node's velocity after one-sided contact with a surface: no penetration, Coulomb's friction.

    `coefficient` is that of slideframe's Wall: Coulomb's, or STICKS or IS_OPEN.
    """
    if coefficient == IS_OPEN:
        return velocity
    if coefficient == STICKS:
        return Vector()
    approach = -wp.dot(velocity, normal)
    if approach <= Real(0.0):
        return velocity
    along = velocity + approach * normal
    speed = wp.length(along)
    # the impulse that stops the approach bounds that of friction (Coulomb)
    if coefficient > Real(0.0):
        if speed <= coefficient * approach:
            return Vector()
        along = along * (Real(1.0) - coefficient * approach / speed)
    return along


@wp.func
def ground(
    velocity: Vector, i: int, j: int, k: int, solid: wp.array2d(dtype=wp.vec3i), normals: wp.array(dtype=Vector4)
):
    """Return a node's velocity after contact with the solid ground, where the node lies in it (ContactNodes)."""
    v = velocity
    if i < solid.shape[0] and j < solid.shape[1]:
        column = solid[i, j]
        layer = k - column[0]
        if layer >= 0 and layer < column[1]:
            normal = normals[column[2] + layer]
            v = contact(v, Vector(normal[0], normal[1], normal[2]), normal[3])
    return v


@wp.func
def walls(velocity: Vector, i: int, j: int, k: int, padding: int, high: wp.vec2i, coefficients: Vector2) -> Vector:
    """Return a node's velocity after contact with the walls of the box; coefficients are of (sides, floor)."""
    v = velocity
    none = Real(0.0)
    one = Real(1.0)
    if i <= padding:
        v = contact(v, Vector(one, none, none), coefficients[0])
    if i >= high[0]:
        v = contact(v, Vector(-one, none, none), coefficients[0])
    if j <= padding:
        v = contact(v, Vector(none, one, none), coefficients[0])
    if j >= high[1]:
        v = contact(v, Vector(none, -one, none), coefficients[0])
    if k <= padding:
        v = contact(v, Vector(none, none, one), coefficients[1])
    return v


@wp.kernel
def update_grid(
    first: int,
    grid: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    owners: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    forces: wp.array(dtype=Vector4),
    velocity_change: Vector,
    kept: Real,
    solid: wp.array2d(dtype=wp.vec3i),
    normals: wp.array(dtype=Vector4),
    padding: int,
    high: wp.vec2i,
    coefficients: Vector2,
):
    """Turn momentum into velocity, apply gravity and damping (`kept` is what that leaves), then ground and walls.

    Where particles keep an excess, the impulses of stress come in `forces`, which leave with the velocity before them.
    """
    node = first + wp.tid()
    entry = grid[node]
    mass = entry[3]
    if mass > Real(0.0):
        i, j, k = place_of(node, columns, owners, corner, across)
        v = Vector(entry[0], entry[1], entry[2]) / mass
        change = velocity_change
        if wp.static(KEEPS_EXCESS):
            impulse = forces[node]
            change += Vector(impulse[0], impulse[1], impulse[2]) / mass
            forces[node] = Vector4(v[0], v[1], v[2], Real(0.0))
        v = kept * (v + change)
        v = ground(v, i, j, k, solid, normals)
        v = walls(v, i, j, k, padding, high, coefficients)
        grid[node] = Vector4(v[0], v[1], v[2], mass)
