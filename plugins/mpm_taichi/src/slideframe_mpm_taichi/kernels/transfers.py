"""Particles to grid and back, with quadratic B-splines."""

import taichi as ti

from slideframe.problem.transfer import LOOSE_STRAIN
from slideframe.tiles import COLOURS

from .arrays import Array
from .layout import Pair
from .materials import hencky_strain, kirchhoff_stress, return_mapping
from .stencils import spline, stencil_around
from .tensors import (
    determinant_of,
    sphere,
    square_of,
    symmetric_product,
    trace_of,
    twice_symmetric_part,
    unpack,
)

# Runs of tiles of one colour: several for each core, so that none waits long for the others.
MOST_RUNS = 64
# Taichi's CPU backend cuts a loop into parts of at least so many steps, however few threads that leaves at work.
LEAST_STEPS = 512
# Parts of a loop over particles, which a processor's threads take one by one: many, so that none waits long.
PARTS = 256
UNBOUNDED = 1e30


@ti.func
def scatter(
    position,
    momentum,
    affine,
    mass,
    columns: ti.template(),
    corner,
    across,
    grid: ti.template(),
    own: ti.template(),
):
    """Add momentum (first three) and mass (last) of one particle to its 27 nodes, each four lanes for LLVM.

    `own`: no other thread touches these nodes.
    """
    column, layer, x, y, z = stencil_around(position, corner, across)
    u, v, w = spline(x), spline(y), spline(z)
    carried = ti.Vector([momentum[0], momentum[1], momentum[2], mass])
    along_x = ti.Vector([affine[0, 0], affine[1, 0], affine[2, 0], 0.0])
    along_y = ti.Vector([affine[0, 1], affine[1, 1], affine[2, 1], 0.0])
    along_z = ti.Vector([affine[0, 2], affine[1, 2], affine[2, 2], 0.0])
    for a, b in ti.static(ti.ndrange(3, 3)):
        row = columns[column + a * across + b] + layer
        sideways = carried + x[a] * along_x + y[b] * along_y
        share = u[a] * v[b]
        for c in ti.static(range(3)):
            contribution = share * w[c] * (sideways + z[c] * along_z)
            if ti.static(own):
                grid[row + c] = grid[row + c] + contribution
            else:
                grid[row + c] += contribution


@ti.kernel
def particles_to_grid(
    positions: Array,
    velocities: Array,
    affines: Array,
    pulls: Array,
    masses: Array,
    columns: Array,
    corner: Pair,
    across: ti.i32,
    grid: Array,
    forces: Array,
    keeps_excess: ti.template(),
    runs: Array,
    run_counts: ti.types.vector(COLOURS, ti.i32),
):
    """Scatter runs of particles in tiles, colour by colour: no two threads share a node, so no sum varies.

    Where particles keep an excess, the impulses of stress go to `forces`; else `affines` have them already.
    """
    for colour in ti.static(range(COLOURS)):
        # a run is one step in LEAST_STEPS, so that each is a part of its own
        ti.loop_config(parallelize=MOST_RUNS)
        for step in range(run_counts[colour] * LEAST_STEPS):
            if step % LEAST_STEPS == 0:
                run = runs[colour, step // LEAST_STEPS]
                for p in range(run[0], run[0] + run[1]):
                    momentum = masses[p] * velocities[p]
                    scatter(positions[p], momentum, affines[p], masses[p], columns, corner, across, grid, True)
                    if ti.static(keeps_excess):
                        scatter(positions[p], 0.0 * momentum, pulls[p], 0.0, columns, corner, across, forces, True)


@ti.kernel
def particles_to_grid_atomic(
    positions: Array,
    velocities: Array,
    affines: Array,
    pulls: Array,
    masses: Array,
    columns: Array,
    corner: Pair,
    across: ti.i32,
    grid: Array,
    forces: Array,
    keeps_excess: ti.template(),
):
    """Scatter all particles at once, as a graphics card does best."""
    for p in range(positions.shape[0]):
        momentum = masses[p] * velocities[p]
        scatter(positions[p], momentum, affines[p], masses[p], columns, corner, across, grid, False)
        if ti.static(keeps_excess):
            scatter(positions[p], 0.0 * momentum, pulls[p], 0.0, columns, corner, across, forces, False)


@ti.func
def gather(position, columns: ti.template(), corner, across, grid: ti.template()):
    """Return the velocity and its moment sum of w v (x_i - x_p)^T, in cells, at one particle."""
    column, layer, x, y, z = stencil_around(position, corner, across)
    u, v, w = spline(x), spline(y), spline(z)
    # relative to the middle node, so that a mass that flies as a whole isn't strained by the weights' rounding
    middle_node = grid[columns[column + across + 1] + layer + 1]
    velocity = ti.Vector([0.0] * 4)
    # nodes stand one cell apart: their moment is that about the middle one, moved
    along_x, along_y, along_z = velocity, velocity, velocity
    for a in ti.static(range(3)):
        plane, slant, tilt = ti.Vector([0.0] * 4), ti.Vector([0.0] * 4), ti.Vector([0.0] * 4)
        for b in ti.static(range(3)):
            node = columns[column + a * across + b] + layer
            low = w[0] * (grid[node] - middle_node)
            middle = w[1] * (grid[node + 1] - middle_node)
            high = w[2] * (grid[node + 2] - middle_node)
            row = v[b] * (low + middle + high)
            plane += row
            tilt += v[b] * (high - low)
            if ti.static(b != 1):
                slant += row if ti.static(b == 2) else -row
        share = u[a] * plane
        velocity += share
        along_y += u[a] * slant
        along_z += u[a] * tilt
        if ti.static(a != 1):
            along_x += share if ti.static(a == 2) else -share
    x_moment, y_moment, z_moment = along_x + x[1] * velocity, along_y + y[1] * velocity, along_z + z[1] * velocity
    moment = ti.Matrix.cols([x_moment, y_moment, z_moment])
    velocity += middle_node
    return ti.Vector([velocity[0], velocity[1], velocity[2]]), ti.Matrix(
        [[moment[row, column] for column in range(3)] for row in range(3)]
    )


@ti.func
def is_loose(x):
    """Whether a particle bears no pressure: log det(1 + X) / 2, its volumetric strain, is none or positive."""
    first = trace_of(x)
    second = 0.5 * (first * first - trace_of(square_of(x)))
    return first + second + determinant_of(x) >= 2.0 * LOOSE_STRAIN


@ti.func
def carry(particle, way, limits: ti.template(), positions: ti.template(), residuals: ti.template()):
    """Move a particle by `way`, in cells, within limits, and return whether it leaves the domain."""
    position = positions[particle]
    residual = residuals[particle]
    leaving = False
    for axis in ti.static(range(3)):
        # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
        step = way[axis] + residual[axis]
        moved = position[axis] + step
        residual[axis] = step - (moved - position[axis])
        # written so that NaN, too, is held: an index made of it would leave the grid
        # what runs away stays, for the watch to find
        if not (moved >= limits[0][axis]):
            leaving = leaving or ti.abs(step) <= 1.0
            moved = limits[0][axis]
        if moved > limits[1][axis]:
            leaving = leaving or ti.abs(step) <= 1.0
            moved = limits[1][axis]
        position[axis] = moved
    positions[particle] = position
    residuals[particle] = residual
    return leaving


@ti.func
def greatest_component(velocity):
    """Return the greatest absolute component, UNBOUNDED for NaN and what is beyond it."""
    greatest = 0.0
    for axis in ti.static(range(3)):
        speed = ti.abs(velocity[axis])
        # written so that NaN, too, is found
        if not (speed <= UNBOUNDED):
            speed = UNBOUNDED
        greatest = ti.max(greatest, speed)
    return greatest


@ti.func
def take_out(
    particle,
    velocities: ti.template(),
    affines: ti.template(),
    pulls: ti.template(),
    masses: ti.template(),
    volumes: ti.template(),
):
    """Let a particle weigh and move nothing from now on."""
    masses[particle] = 0.0
    volumes[particle] = 0.0
    velocities[particle] = ti.Vector([0.0, 0.0, 0.0])
    affines[particle] = sphere(0.0)
    pulls[particle] = sphere(0.0)


@ti.kernel
def grid_to_particles(
    grid: Array,
    forces: Array,
    keeps_excess: ti.template(),
    columns: Array,
    corner: Pair,
    across: ti.i32,
    positions: Array,
    residuals: Array,
    velocities: Array,
    affines: Array,
    pulls: Array,
    elastic_states: Array,
    held: Array,
    masses: Array,
    volumes: Array,
    way_of_speed: float,
    transfers: Array,
    limits: Array,
) -> float:
    """Gather velocity and, into `affines`, its moment, and move the particle; `transfers` holds TransferConstants.

    Returns the greatest component of velocity, UNBOUNDED for NaN.
    """
    fastest = 0.0
    ti.loop_config(parallelize=PARTS)
    for particle in range(positions.shape[0]):
        # what has left the domain weighs nothing and stays where it left
        if masses[particle] != 0.0:
            position = positions[particle]
            velocity, moment = gather(position, columns, corner, across, grid)
            affines[particle] = moment
            carrying = velocity
            if ti.static(keeps_excess):
                # Fei et al. 2021; only what bore no pressure may move against its neighbours
                before, _ = gather(position, columns, corner, across, forces)
                excess = velocities[particle] - before
                if is_loose(elastic_states[particle]):
                    carrying += transfers[0][2] * excess
                velocity += transfers[0][1] * excess
            velocities[particle] = velocity
            ti.atomic_max(fastest, greatest_component(velocity))
            if ti.static(keeps_excess):
                ti.atomic_max(fastest, greatest_component(carrying))
            if carry(particle, way_of_speed * carrying, limits, positions, residuals):
                held[particle] = 1
                take_out(particle, velocities, affines, pulls, masses, volumes)
    return fastest


@ti.func
def strain(
    particle,
    change,
    elastic_states: ti.template(),
    volume_corrections: ti.template(),
    plastic_strains: ti.template(),
    records: ti.template(),
    law: ti.template(),
    soil,
    series_radius,
):
    """Strain a particle by `change` = dt grad v, let it yield, and return its elastic Hencky strain."""
    state = elastic_states[particle]
    # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
    half = change + change @ unpack(state)
    trial = state + twice_symmetric_part(half) + symmetric_product(half, change)
    state, hencky, correction, sheared = return_mapping(law, trial, volume_corrections[particle], soil, series_radius)
    elastic_states[particle] = state
    volume_corrections[particle] = correction
    if ti.static(records):
        plastic_strains[particle] += sheared
    return hencky


@ti.kernel
def strain_particles(
    affines: Array,
    pulls: Array,
    keeps_excess: ti.template(),
    elastic_states: Array,
    volume_corrections: Array,
    plastic_strains: Array,
    records: ti.template(),
    deformation_gradients: Array,
    masses: Array,
    volumes: Array,
    scale: float,
    affine_share: float,
    law: ti.template(),
    soils: Array,
    series_radius: float,
):
    """Strain each particle, let it yield, and prepare its next scatter.

    `scale` = 4 dt / spacing makes of the moment in `affines` dt grad v (Jiang et al. 2015: C = 4 / spacing^2 times it,
    in m, for quadratic splines).
    """
    ti.loop_config(parallelize=PARTS)
    for particle in range(affines.shape[0]):
        mass = masses[particle]
        if mass != 0.0:
            moment = affines[particle]
            change = scale * moment
            gradient = deformation_gradients[particle]
            deformation_gradients[particle] = gradient + change @ gradient
            hencky = strain(
                particle, change, elastic_states, volume_corrections, plastic_strains, records, law, soils[0],
                series_radius,
            )  # fmt: skip
            pull = -scale * volumes[particle] * unpack(kirchhoff_stress(hencky, soils[0]))
            if ti.static(keeps_excess):
                pulls[particle] = pull
                affines[particle] = affine_share * 4.0 * mass * moment
            else:
                affines[particle] = 4.0 * mass * moment + pull


@ti.kernel
def retime(pulls: Array, elastic_states: Array, volumes: Array, change: float, soils: Array, series_radius: float):
    """Make the stress term of the next scatter for another time step; `change` is 4 (old - new) / spacing."""
    for particle in range(pulls.shape[0]):
        hencky = hencky_strain(elastic_states[particle], series_radius)
        pulls[particle] += change * volumes[particle] * unpack(kirchhoff_stress(hencky, soils[0]))
