"""Particles to grid and back, with quadratic B-splines."""

import taichi as ti

from .arrays import Array
from .materials import kirchhoff_stress, return_mapping
from .tensors import pack, unpack

# A slab of four layers of cells plus a drift of one cell either way never shares a node with the next but one.
SLAB_WIDTH = 4
CHUNK = 256


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
def scatter(position, momentum, affine, mass, stride, grid: ti.template(), exclusive: ti.template()):
    """Add momentum (first three) and mass (last) of one particle to its 27 nodes."""
    first = ti.cast(position - 0.5, ti.i32)
    x_arms, y_arms, z_arms = arms(position[0] - first[0]), arms(position[1] - first[1]), arms(position[2] - first[2])
    x_weights, y_weights, z_weights = spline(x_arms), spline(y_arms), spline(z_arms)
    for a, b in ti.static(ti.ndrange(3, 3)):
        weight = x_weights[a] * y_weights[b]
        node = (first[0] + a) * stride[0] + (first[1] + b) * stride[1] + first[2]
        for c in ti.static(range(3)):
            carried = momentum + affine @ ti.Vector([x_arms[a], y_arms[b], z_arms[c]])
            contribution = weight * z_weights[c] * ti.Vector([carried[0], carried[1], carried[2], mass])
            if ti.static(exclusive):
                grid[node + c] = grid[node + c] + contribution
            else:
                grid[node + c] += contribution


@ti.kernel
def particles_to_grid(
    positions: Array,
    velocities: Array,
    affines: Array,
    masses: Array,
    stride: ti.types.vector(2, ti.i32),
    slab_starts: Array,
    parity: ti.i32,
    grid: Array,
):
    """Scatter the particles of every other slab, in their order: no two threads share a node, so no sum varies."""
    ti.loop_config(block_dim=1)
    for pair in range((slab_starts.shape[0] - 1) // 2):
        slab = 2 * pair + parity
        for p in range(slab_starts[slab], slab_starts[slab + 1]):
            scatter(positions[p], masses[p] * velocities[p], affines[p], masses[p], stride, grid, True)


@ti.kernel
def particles_to_grid_atomic(
    positions: Array, velocities: Array, affines: Array, masses: Array, stride: ti.types.vector(2, ti.i32), grid: Array
):
    """Scatter all particles at once, as a graphics card does best."""
    for p in range(positions.shape[0]):
        scatter(positions[p], masses[p] * velocities[p], affines[p], masses[p], stride, grid, False)


@ti.func
def gather(position, stride, grid: ti.template()):
    """Return the velocity and its moment sum of w v (x_i - x_p)^T, in cells, at one particle."""
    first = ti.cast(position - 0.5, ti.i32)
    x_arms, y_arms, z_arms = arms(position[0] - first[0]), arms(position[1] - first[1]), arms(position[2] - first[2])
    x_weights, y_weights, z_weights = spline(x_arms), spline(y_arms), spline(z_arms)
    velocity = ti.Vector([0.0, 0.0, 0.0])
    x_moment, y_moment, z_moment = velocity, velocity, velocity
    for a, b in ti.static(ti.ndrange(3, 3)):
        weight = x_weights[a] * y_weights[b]
        node = (first[0] + a) * stride[0] + (first[1] + b) * stride[1] + first[2]
        row = ti.Vector([0.0, 0.0, 0.0])
        for c in ti.static(range(3)):
            entry = grid[node + c]
            share = weight * z_weights[c] * ti.Vector([entry[0], entry[1], entry[2]])
            row += share
            z_moment += z_arms[c] * share
        velocity += row
        x_moment += x_arms[a] * row
        y_moment += y_arms[b] * row
    return velocity, ti.Matrix.cols([x_moment, y_moment, z_moment])


@ti.kernel
def grid_to_particles(
    grid: Array,
    stride: ti.types.vector(2, ti.i32),
    positions: Array,
    residuals: Array,
    velocities: Array,
    affines: Array,
    elastic_states: Array,
    volume_corrections: Array,
    deformation_gradients: Array,
    held: Array,
    masses: Array,
    volumes: Array,
    time_step: float,
    spacing: float,
    law: ti.template(),
    soils: Array,
    shape: ti.types.vector(3, ti.i32),
    series_radius: float,
    fastest: Array,
):
    """Gather velocity and its gradient, move the particle, strain it, and prepare its next scatter.

    `fastest` receives the greatest component of velocity in each chunk of particles.
    """
    ti.loop_config(block_dim=1)
    for chunk in range(fastest.shape[0]):
        chunk_fastest = 0.0
        for particle in range(chunk * CHUNK, ti.min((chunk + 1) * CHUNK, positions.shape[0])):
            position = positions[particle]
            velocity, moment = gather(position, stride, grid)

            # C = 4 / spacing * moment (Jiang et al. 2015: D = spacing^2 / 4 for quadratic splines)
            change = time_step * 4.0 / spacing * moment
            deformation_gradients[particle] += change @ deformation_gradients[particle]
            x = unpack(elastic_states[particle])
            # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
            half = change + change @ x
            trial = x + half + half.transpose() + half @ change.transpose()
            state, hencky, correction, _ = return_mapping(
                law, trial, volume_corrections[particle], soils[0], series_radius
            )
            stress = kirchhoff_stress(hencky, soils[0])
            affines[particle] = 4.0 * masses[particle] * moment - 4.0 * volumes[particle] * time_step / spacing * stress
            elastic_states[particle] = pack(state)
            volume_corrections[particle] = correction
            velocities[particle] = velocity
            residual = residuals[particle]
            for axis in ti.static(range(3)):
                # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
                step = time_step / spacing * velocity[axis] + residual[axis]
                moved = position[axis] + step
                residual[axis] = step - (moved - position[axis])
                # written so that NaN, too, is held: an index made of it would leave the grid
                if not (moved >= 1.0):
                    moved = 1.0
                    residual[axis] = 0.0
                    held[particle] = 1
                if moved > shape[axis] - 2.0:
                    moved = shape[axis] - 2.0
                    residual[axis] = 0.0
                    held[particle] = 1
                position[axis] = moved
                chunk_fastest = ti.max(chunk_fastest, ti.abs(velocity[axis]))
            positions[particle] = position
            residuals[particle] = residual
        fastest[chunk] = chunk_fastest
