"""Particles to grid and back, with quadratic B-splines."""

import warp as wp

from slideframe.problem.transfer import LOOSE_STRAIN

from .materials import DRUCKER_PRAGER, Soil, hencky_strain, kirchhoff_stress, return_mapping
from .reals import KEEPS_EXCESS, LANES, SHARED_NODES, Matrix, Real, Vector, Vector4, Vector6
from .stencils import stencil_around
from .tensors import pack, unpack

if SHARED_NODES:
    from .nodes import gather, scatter, strain_lanes
else:
    from .lanes import strain_lanes
    from .rows import gather, scatter

wp.set_module_options({"enable_backward": False})

# Particles that share one entry of `fastest`: many, to save memory, but few enough not to wait for one another.
CHUNK = wp.constant(256)
UNBOUNDED = wp.constant(Real(1e30))
LOOSE_STRAIN = wp.constant(Real(LOOSE_STRAIN))


@wp.kernel
def particles_to_grid(
    first: int,
    positions: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    columns: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    grid: wp.array(dtype=Vector4),
    forces: wp.array(dtype=Vector4),
):
    """Scatter momentum (first three) and mass (last) of every particle to its 27 nodes.

    Where particles keep an excess, the impulses of stress go to `forces`; else `affines` have them already.
    """
    particle = first + wp.tid()
    mass = masses[particle]
    stencil = stencil_around(positions[particle], corner, across)
    scatter(grid, columns, across, stencil, mass * velocities[particle], affines[particle], mass)
    if wp.static(KEEPS_EXCESS):
        scatter(forces, columns, across, stencil, Vector(), pulls[particle], Real(0.0))


@wp.func
def is_loose(x: Matrix) -> bool:
    """Whether a particle bears no pressure: log det(1 + X) / 2, its volumetric strain, is none or positive."""
    first = wp.trace(x)
    second = Real(0.5) * (first * first - wp.trace(x * x))
    return first + second + wp.determinant(x) >= Real(2.0) * LOOSE_STRAIN


@wp.func
def carry(
    particle: int,
    way: Vector,
    lowest: Vector,
    highest: Vector,
    positions: wp.array(dtype=Vector),
    residuals: wp.array(dtype=Vector),
) -> bool:
    """Move a particle by `way`, in cells, within limits, and return whether it leaves the domain."""
    position = positions[particle]
    residual = residuals[particle]
    leaving = False
    for axis in range(3):
        # Kahan's summation: a slow particle's step is below the rounding of its place, and would be lost
        step = way[axis] + residual[axis]
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
    return leaving


@wp.func
def greatest_component(velocity: Vector) -> Real:
    """Return the greatest absolute component, UNBOUNDED for NaN and what is beyond it."""
    greatest = wp.max(wp.abs(velocity))
    # wp.max passes over NaN, a sum doesn't
    if not (wp.abs(velocity[0]) + wp.abs(velocity[1]) + wp.abs(velocity[2]) <= UNBOUNDED):
        greatest = UNBOUNDED
    return greatest


@wp.func
def take_out(
    particle: int,
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
):
    """Let a particle weigh and move nothing from now on."""
    masses[particle] = Real(0.0)
    volumes[particle] = Real(0.0)
    velocities[particle] = Vector()
    affines[particle] = Matrix()
    pulls[particle] = Matrix()


@wp.kernel
def grid_to_particles(
    first: int,
    grid: wp.array(dtype=Vector4),
    forces: wp.array(dtype=Vector4),
    columns: wp.array(dtype=int),
    corner: wp.vec2i,
    across: int,
    positions: wp.array(dtype=Vector),
    residuals: wp.array(dtype=Vector),
    velocities: wp.array(dtype=Vector),
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    held: wp.array(dtype=wp.int32),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
    fastest: wp.array(dtype=Real),
    way_of_speed: Real,
    transfer: Vector,
    lowest: Vector,
    highest: Vector,
):
    """Gather velocity and, into `affines`, its moment, and move the particle; `transfer` are TransferConstants.

    `fastest` receives the greatest component of velocity in each chunk of particles, UNBOUNDED for NaN.
    """
    particle = first + wp.tid()
    # what has left the domain weighs nothing and stays where it left
    if masses[particle] == Real(0.0):
        return
    stencil = stencil_around(positions[particle], corner, across)
    gathered = gather(grid, columns, across, stencil)
    affines[particle] = Matrix(
        gathered[0, 0], gathered[0, 1], gathered[0, 2],
        gathered[1, 0], gathered[1, 1], gathered[1, 2],
        gathered[2, 0], gathered[2, 1], gathered[2, 2],
    )  # fmt: skip
    velocity = Vector(gathered[0, 3], gathered[1, 3], gathered[2, 3])
    carrying = velocity
    if wp.static(KEEPS_EXCESS):
        # Fei et al. 2021; only what bore no pressure may move against its neighbours
        before = gather(forces, columns, across, stencil)
        excess = velocities[particle] - Vector(before[0, 3], before[1, 3], before[2, 3])
        if is_loose(unpack(elastic_states[particle])):
            carrying += transfer[2] * excess
        velocity += transfer[1] * excess
    velocities[particle] = velocity
    if carry(particle, way_of_speed * carrying, lowest, highest, positions, residuals):
        held[particle] = 1
        take_out(particle, velocities, affines, pulls, masses, volumes)
    wp.atomic_max(fastest, particle // CHUNK, greatest_component(velocity))
    if wp.static(KEEPS_EXCESS):
        wp.atomic_max(fastest, particle // CHUNK, greatest_component(carrying))


@wp.func
def strain(
    particle: int,
    change: Matrix,
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    plastic_strains: wp.array(dtype=Real),
    law: int,
    soil: Soil,
    sweeps: int,
) -> Matrix:
    """Strain a particle by `change` = dt grad v, let it yield, and return its elastic Hencky strain."""
    x = unpack(elastic_states[particle])
    # b = (1 + G)(1 + X)(1 + G)^T, without ever adding a small number to 1
    half = change + change * x
    # packed, so that the compiler knows it to be symmetric
    trial = unpack(pack(x + half + wp.transpose(half) + half * wp.transpose(change)))
    state, hencky, correction, sheared = return_mapping(law, trial, volume_corrections[particle], soil, sweeps)
    elastic_states[particle] = pack(state)
    volume_corrections[particle] = correction
    # there are none unless they are asked for
    if plastic_strains.shape[0] > 0:
        plastic_strains[particle] += sheared
    return hencky


@wp.kernel
def strain_particles(
    first: int,
    end: int,
    affines: wp.array(dtype=Matrix),
    pulls: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volume_corrections: wp.array(dtype=Real),
    plastic_strains: wp.array(dtype=Real),
    deformation_gradients: wp.array(dtype=Matrix),
    masses: wp.array(dtype=Real),
    volumes: wp.array(dtype=Real),
    scale: Real,
    affine_share: Real,
    law: int,
    soil: Soil,
    sweeps: int,
):
    """Strain each particle, let it yield, and prepare its next scatter; `scale` = 4 dt / spacing makes of the moment
    in `affines` dt grad v (Jiang et al. 2015: C = 4 / spacing^2 times it, in m, for quadratic splines).
    """
    begin = first + LANES * wp.tid()
    count = wp.min(LANES, end - begin)
    for particle in range(begin, begin + count):
        if masses[particle] != Real(0.0):
            deformation_gradients[particle] += scale * affines[particle] * deformation_gradients[particle]
    undone = (1 << count) - 1
    if law == DRUCKER_PRAGER:
        undone = strain_lanes(
            begin, count, scale, affine_share, soil, affines, pulls, elastic_states, volume_corrections,
            plastic_strains, masses, volumes,
        )  # fmt: skip
    if undone == 0:
        return
    for lane in range(count):
        particle = begin + lane
        mass = masses[particle]
        if (undone >> lane) & 1 == 1 and mass != Real(0.0):
            moment = affines[particle]
            hencky = strain(
                particle, scale * moment, elastic_states, volume_corrections, plastic_strains, law, soil, sweeps
            )
            pull = -scale * volumes[particle] * kirchhoff_stress(hencky, soil)
            if wp.static(KEEPS_EXCESS):
                pulls[particle] = pull
                affines[particle] = affine_share * Real(4.0) * mass * moment
            else:
                affines[particle] = Real(4.0) * mass * moment + pull


@wp.kernel
def retime(
    first: int,
    pulls: wp.array(dtype=Matrix),
    elastic_states: wp.array(dtype=Vector6),
    volumes: wp.array(dtype=Real),
    change: Real,
    soil: Soil,
    sweeps: int,
):
    """Make the stress term of the next scatter for another time step; `change` is 4 (old - new) / spacing."""
    particle = first + wp.tid()
    hencky = hencky_strain(unpack(elastic_states[particle]), sweeps)
    pulls[particle] += change * volumes[particle] * kirchhoff_stress(hencky, soil)
