"""Particles to grid and back, with quadratic B-splines."""

import warp as wp

from .materials import Soil, kirchhoff_stress, return_mapping
from .reals import Matrix, Real, Vector, Vector4, Vector6
from .tensors import pack, unpack

wp.set_module_options({"enable_backward": False})


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


@wp.kernel
def particles_to_grid(
    positions: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    stride: wp.vec2i,
    grid: wp.array(dtype=Vector4),
):
    """Scatter momentum (first three) and mass (last) of every particle to its 27 nodes."""
    particle = wp.tid()
    position = positions[particle]
    i = int(position[0] - Real(0.5))
    j = int(position[1] - Real(0.5))
    k = int(position[2] - Real(0.5))
    x_arms = arms(position[0] - Real(i))
    y_arms = arms(position[1] - Real(j))
    z_arms = arms(position[2] - Real(k))
    x_weights = spline(x_arms)
    y_weights = spline(y_arms)
    z_weights = spline(z_arms)
    mass = masses[particle]
    momentum = mass * velocities[particle]
    affine = affines[particle]
    for a in range(3):
        for b in range(3):
            weight = x_weights[a] * y_weights[b]
            node = (i + a) * stride[0] + (j + b) * stride[1] + k
            for c in range(3):
                carried = momentum + affine * Vector(x_arms[a], y_arms[b], z_arms[c])
                share = weight * z_weights[c]
                wp.atomic_add(grid, node + c, share * Vector4(carried[0], carried[1], carried[2], mass))


@wp.kernel
def grid_to_particles(
    grid: wp.array(dtype=Vector4),
    stride: wp.vec2i,
    positions: wp.array(dtype=Vector),
    residuals: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    deformation_gradients: wp.array(dtype=Matrix),
    held: wp.array(dtype=wp.int32),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
    time_step: Real,
    spacing: Real,
    law: int,
    soil: Soil,
    last_position: Vector,
    sweeps: int,
):
    """Gather velocity and its gradient, move the particle, strain it, and prepare its next scatter."""
    particle = wp.tid()
    position = positions[particle]
    i = int(position[0] - Real(0.5))
    j = int(position[1] - Real(0.5))
    k = int(position[2] - Real(0.5))
    x_arms = arms(position[0] - Real(i))
    y_arms = arms(position[1] - Real(j))
    z_arms = arms(position[2] - Real(k))
    x_weights = spline(x_arms)
    y_weights = spline(y_arms)
    z_weights = spline(z_arms)
    velocity = Vector()
    x_moment = Vector()
    y_moment = Vector()
    z_moment = Vector()
    for a in range(3):
        for b in range(3):
            weight = x_weights[a] * y_weights[b]
            node = (i + a) * stride[0] + (j + b) * stride[1] + k
            row = Vector()
            for c in range(3):
                entry = grid[node + c]
                share = weight * z_weights[c] * Vector(entry[0], entry[1], entry[2])
                row += share
                z_moment += z_arms[c] * share
            velocity += row
            x_moment += x_arms[a] * row
            y_moment += y_arms[b] * row
    moment = wp.matrix_from_cols(x_moment, y_moment, z_moment)

    # C = 4 / spacing * moment (Jiang et al. 2015: D = spacing^2 / 4 for quadratic splines)
    change = time_step * Real(4.0) / spacing * moment
    deformation_gradients[particle] += change * deformation_gradients[particle]
    x = unpack(elastic_states[particle])
    # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
    half = change + change * x
    trial = x + half + wp.transpose(half) + half * wp.transpose(change)
    state, hencky, correction, _sheared = return_mapping(law, trial, volume_corrections[particle], soil, sweeps)
    stress = kirchhoff_stress(hencky, soil)
    affines[particle] = (
        Real(4.0) * masses[particle] * moment - Real(4.0) * volumes[particle] * time_step / spacing * stress
    )
    elastic_states[particle] = pack(state)
    volume_corrections[particle] = correction
    velocities[particle] = velocity
    residual = residuals[particle]
    for axis in range(3):
        # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
        step = time_step / spacing * velocity[axis] + residual[axis]
        moved = position[axis] + step
        residual[axis] = step - (moved - position[axis])
        # written so that NaN, too, is held: an index made of it would leave the grid
        if not (moved >= Real(1.0)):
            moved = Real(1.0)
            residual[axis] = Real(0.0)
            held[particle] = 1
        if moved > last_position[axis]:
            moved = last_position[axis]
            residual[axis] = Real(0.0)
            held[particle] = 1
        position[axis] = moved
    positions[particle] = position
    residuals[particle] = residual
