"""Particles to grid and back, with quadratic B-splines."""

import warp as wp

from .materials import Soil, hencky_strain, kirchhoff_stress, return_mapping
from .reals import SHARED_NODES, Matrix, Real, Vector, Vector4, Vector6
from .stencils import stencil_around
from .tensors import pack, unpack

if SHARED_NODES:
    from .nodes import gather, scatter
else:
    from .rows import gather, scatter

wp.set_module_options({"enable_backward": False})

# Particles that share one entry of `fastest`: many, to save memory, but few enough not to wait for one another.
CHUNK = wp.constant(256)
UNBOUNDED = wp.constant(Real(1e30))


@wp.kernel
def particles_to_grid(
    first: int,
    positions: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    columns: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    grid: wp.array(dtype=Vector4),
):
    """Scatter momentum (first three) and mass (last) of every particle to its 27 nodes."""
    particle = first + wp.tid()
    mass = masses[particle]
    stencil = stencil_around(positions[particle], corner, across)
    scatter(grid, columns, across, stencil, mass * velocities[particle], affines[particle], mass)


@wp.kernel
def grid_to_particles(
    first: int,
    grid: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
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
    fastest: wp.array(dtype=Real),
    time_step: Real,
    spacing: Real,
    law: int,
    soil: Soil,
    lowest: Vector,
    highest: Vector,
    sweeps: int,
):
    """Gather velocity and its gradient, move the particle, strain it, and prepare its next scatter.

    `fastest` receives the greatest component of velocity in each chunk of particles, UNBOUNDED for NaN.
    """
    particle = first + wp.tid()
    # what has left the domain weighs nothing and stays where it left
    if masses[particle] == Real(0.0):
        return
    position = positions[particle]
    gathered = gather(grid, columns, across, stencil_around(position, corner, across))
    velocity = Vector(gathered[0, 3], gathered[1, 3], gathered[2, 3])
    moment = Matrix(
        gathered[0, 0], gathered[0, 1], gathered[0, 2],
        gathered[1, 0], gathered[1, 1], gathered[1, 2],
        gathered[2, 0], gathered[2, 1], gathered[2, 2],
    )  # fmt: skip

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
    leaving = False
    for axis in range(3):
        # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
        step = time_step / spacing * velocity[axis] + residual[axis]
        moved = position[axis] + step
        residual[axis] = step - (moved - position[axis])
        # written so that NaN, too, is held: an index made of it would leave the grid
        # what runs away stays, for the watch to find
        if not (moved >= lowest[axis]):
            leaving = leaving or wp.abs(step) <= Real(1.0)
            moved = lowest[axis]
        if moved > highest[axis]:
            leaving = leaving or wp.abs(step) <= Real(1.0)
            moved = highest[axis]
        position[axis] = moved
    positions[particle] = position
    residuals[particle] = residual
    if leaving:
        held[particle] = 1
        masses[particle] = Real(0.0)
        volumes[particle] = Real(0.0)
        velocities[particle] = Vector()
        affines[particle] = Matrix()
    speed = wp.max(wp.abs(velocity))
    if not (speed <= UNBOUNDED):
        speed = UNBOUNDED
    wp.atomic_max(fastest, particle // CHUNK, speed)


@wp.kernel
def retime(
    first: int,
    affines: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volumes: wp.array(dtype=Real),
    change: Real,
    soil: Soil,
    sweeps: int,
):
    """Make the stress term of the next scatter for another time step; `change` is 4 (old - new) / spacing."""
    particle = first + wp.tid()
    hencky = hencky_strain(unpack(elastic_states[particle]), sweeps)
    affines[particle] += change * volumes[particle] * kirchhoff_stress(hencky, soil)
