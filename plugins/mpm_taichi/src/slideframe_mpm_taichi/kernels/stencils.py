"""Quadratic B-splines around one particle."""

import taichi as ti

from .layout import column_of, first_node


@ti.func
def arms(offset):
    """Return the way from a particle to its three nodes along one axis; `offset` is from the first node, in cells."""
    return ti.Vector([-offset, 1.0 - offset, 2.0 - offset])


@ti.func
def spline(arm):
    """Return the quadratic B-spline's weights of three nodes."""
    low = 1.5 + arm[0]
    high = 1.5 - arm[2]
    return ti.Vector([0.5 * low * low, 0.75 - arm[1] * arm[1], 0.5 * high * high])


@ti.func
def stencil_around(position, corner, across):
    """Return the first of the nodes around a position in cells, by column and layer, and the arms along x, y and z."""
    node = first_node(position)
    x, y, z = arms(position[0] - node[0]), arms(position[1] - node[1]), arms(position[2] - node[2])
    return column_of(node, corner, across), node[2], x, y, z
