"""Quadratic B-splines around one particle."""

import warp as wp

from .layout import column_of, first_node
from .reals import Real, Vector

wp.set_module_options({"enable_backward": False})


@wp.struct
class Stencil:
    """Where a particle's 27 nodes are, in cells, and what share of it each takes along each axis."""

    column: int
    layer: int
    x_arms: Vector
    y_arms: Vector
    z_arms: Vector
    x_weights: Vector
    y_weights: Vector
    z_weights: Vector


@wp.func
def arms(offset: Real) -> Vector:
    """Return the way from a particle to its three nodes along one axis; `offset` is from the first node, in cells."""
    return Vector(-offset, Real(1.0) - offset, Real(2.0) - offset)


@wp.func
def spline(arm: Vector) -> Vector:
    """Return the quadratic B-spline's weights of three nodes."""
    low = Real(1.5) + arm[0]
    high = Real(1.5) - arm[2]
    return Vector(Real(0.5) * low * low, Real(0.75) - arm[1] * arm[1], Real(0.5) * high * high)


@wp.func
def stencil_around(position: Vector, corner: wp.vec2i, across: int) -> Stencil:
    """Return the nodes around a position in cells, the first of them by column and layer, and their weights."""
    node = first_node(position)
    stencil = Stencil()
    stencil.column = column_of(node, corner, across)
    stencil.layer = node[2]
    stencil.x_arms = arms(position[0] - Real(node[0]))
    stencil.y_arms = arms(position[1] - Real(node[1]))
    stencil.z_arms = arms(position[2] - Real(node[2]))
    stencil.x_weights = spline(stencil.x_arms)
    stencil.y_weights = spline(stencil.y_arms)
    stencil.z_weights = spline(stencil.z_arms)
    return stencil
