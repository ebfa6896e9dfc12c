"""One particle and its 27 nodes on a graphics card: every sum is atomic, since many threads share a node."""

import warp as wp

from .materials import Soil
from .reals import Gathered, Matrix, Real, Vector, Vector4, Vector6
from .stencils import Stencil

wp.set_module_options({"enable_backward": False})


@wp.func
def scatter(
    grid: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    across: int,
    stencil: Stencil,
    momentum: Vector,
    affine: Matrix,
    mass: Real,
):
    """Add momentum (first three) and mass (last) of one particle to its 27 nodes."""
    for a in range(3):
        for b in range(3):
            weight = stencil.x_weights[a] * stencil.y_weights[b]
            node = columns[stencil.column + a * across + b] + stencil.layer
            for c in range(3):
                carried = momentum + affine * Vector(stencil.x_arms[a], stencil.y_arms[b], stencil.z_arms[c])
                share = weight * stencil.z_weights[c]
                wp.atomic_add(grid, node + c, share * Vector4(carried[0], carried[1], carried[2], mass))


@wp.func
def gather(grid: wp.array(dtype=Vector4), columns: wp.array(dtype=int), across: int, stencil: Stencil) -> Gathered:
    """Return the moment sum of w v (x_i - x_p)^T, in cells, and as the last column the velocity, at one particle."""
    velocity = Vector()
    x_moment = Vector()
    y_moment = Vector()
    z_moment = Vector()
    for a in range(3):
        for b in range(3):
            weight = stencil.x_weights[a] * stencil.y_weights[b]
            node = columns[stencil.column + a * across + b] + stencil.layer
            row = Vector()
            for c in range(3):
                entry = grid[node + c]
                share = weight * stencil.z_weights[c] * Vector(entry[0], entry[1], entry[2])
                row += share
                z_moment += stencil.z_arms[c] * share
            velocity += row
            x_moment += stencil.x_arms[a] * row
            y_moment += stencil.y_arms[b] * row
    return wp.matrix_from_cols(x_moment, y_moment, z_moment, velocity)


@wp.func
def strain_lanes(
    first: int,
    count: int,
    scale: Real,
    affine_share: Real,
    soil: Soil,
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    plastic_strains: wp.array(dtype=Real),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
) -> int:
    """Leave all to `materials`, one by one: a card's threads are its lanes."""
    return (1 << count) - 1
