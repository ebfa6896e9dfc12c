"""The grid between the transfers: forces become velocities, and walls act on them."""

import warp as wp

from .layout import place_of
from .reals import Real, Vector, Vector2, Vector4

wp.set_module_options({"enable_backward": False})

SLIP = wp.constant(0)
STICK = wp.constant(1)
FRICTION = wp.constant(2)


@wp.func
def wall(velocity: Vector, axis: int, inward: Real, kind: int, friction: Real) -> Vector:
    """Return a node's velocity after one-sided contact with a plane whose normal is `inward` along `axis`."""
    if kind == STICK:
        return Vector()
    approach = -inward * velocity[axis]
    if approach <= Real(0.0):
        return velocity
    along = velocity
    along[axis] = Real(0.0)
    if kind == FRICTION:
        speed = wp.length(along)
        # the impulse that stops the approach bounds that of friction (Coulomb)
        if speed <= friction * approach:
            return Vector()
        along = along * (Real(1.0) - friction * approach / speed)
    return along


@wp.kernel
def update_grid(
    first: int,
    grid: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    owners: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    velocity_change: Vector,
    padding: int,
    high: wp.vec2i,
    wall_kinds: wp.vec2i,
    wall_frictions: Vector2,
):
    """Turn momentum into velocity, apply gravity, then the walls; the kinds and frictions are of (sides, floor)."""
    node = first + wp.tid()
    entry = grid[node]
    mass = entry[3]
    if mass > Real(0.0):
        i, j, k = place_of(node, columns, owners, corner, across)
        v = Vector(entry[0], entry[1], entry[2]) / mass + velocity_change
        if i <= padding:
            v = wall(v, 0, Real(1.0), wall_kinds[0], wall_frictions[0])
        if i >= high[0]:
            v = wall(v, 0, Real(-1.0), wall_kinds[0], wall_frictions[0])
        if j <= padding:
            v = wall(v, 1, Real(1.0), wall_kinds[0], wall_frictions[0])
        if j >= high[1]:
            v = wall(v, 1, Real(-1.0), wall_kinds[0], wall_frictions[0])
        if k <= padding:
            v = wall(v, 2, Real(1.0), wall_kinds[1], wall_frictions[1])
        grid[node] = Vector4(v[0], v[1], v[2], mass)
