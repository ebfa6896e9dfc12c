"""What must not change in free flight: mass, momentum, angular momentum; and what may only fall: energy."""

from collections.abc import Iterator
from typing import cast

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import AffineTransfer, Elastic, Simulation, SimulationProblem, Transfer, Vector
from slideframe.verification import collapse
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import filling, lattice

SPACING = 0.125
EDGE = 0.5
CENTRE = np.array([1.0, 1.0, 1.0])
GRAVITY: Vector = (0.5, -0.25, -9.81)
APIC = AffineTransfer()
# of the spinning plate, m
MIDDLE = (1.0, SPACING, 1.0)
# frames are float32, and a mean over a few hundred particles keeps most of it
ROUNDING = 1e-6


def flying_block(rig: Rig, spin: Vector, squeeze: float, gravity: Vector, transfer: Transfer = APIC) -> Motion:
    """Return an elastic cube that flies, spins (1/s) and is squeezed along z (1/s) without touching a wall."""
    counts = [round(2 * EDGE / SPACING)] * 3
    positions, volume = lattice(list(CENTRE - EDGE / 2), list(CENTRE + EDGE / 2), counts)
    arms = positions - CENTRE
    velocities = np.cross(np.array(spin), arms) - squeeze * arms * np.array([0.0, 0.0, 1.0])
    start = filling(positions, volume, ((0, 0, 0), (2, 2, 2)), particle_velocities=velocities.astype(np.float32))
    problem = SimulationProblem(
        material=Elastic(density=1000, youngs_modulus=1e6, poisson_ratio=0.3),
        simulation=Simulation(duration=0.2, frame_rate=50, grid_spacing=SPACING, gravity=gravity, transfer=transfer),
    )
    return rig.run(start, problem)


def momentum(motion: Motion) -> Float64Array:
    """Return the linear momentum (frame, 3), kg m/s."""
    total: Float64Array = np.einsum("p,fpi->fi", motion.masses, motion.velocities)
    return total


def budgets(rig: Rig) -> Iterator[Line]:
    """Mass and momentum of a block that vibrates, spins and falls: no stress may change them."""
    motion = flying_block(rig, (1.0, -2.0, 3.0), 2.0, GRAVITY)
    mass = motion.problem.material.density * float(motion.filling.particle_volumes.sum(dtype=np.float64))
    reported = cast(float, motion.figures["mass_kg"])
    yield Line("mass of a flying block, to its start's", "", 1.0, reported / mass, ROUNDING, "conservation of mass")
    fallen = momentum(motion)[-1] - momentum(motion)[0]
    expected = mass * np.array(GRAVITY) * motion.times[-1]
    error = float(np.abs(fallen - expected).max() / np.abs(expected).max())
    yield Line("its momentum, error to the impulse of gravity", "", 0.0, error, 1e-5, "Newton's second law")


def spinning_plate(rig: Rig, transfer: Transfer = APIC) -> Motion:
    """Return a square plate between slip walls that turns by one radian."""
    cells, middle = 8, np.array(MIDDLE)
    half = np.array([cells / 2, 1.0, cells / 2]) * SPACING
    positions, volume = lattice(list(middle - half), list(middle + half), (2 * cells, 2, 2 * cells))
    velocities = np.cross(np.array([0.0, 1.0, 0.0]), positions - middle)
    start = filling(
        positions, volume, ((0, 0, 0), (2, 2 * SPACING, 2)), particle_velocities=velocities.astype(np.float32)
    )
    problem = SimulationProblem(
        material=Elastic(density=1000, youngs_modulus=3e5, poisson_ratio=0.3),
        simulation=Simulation(duration=1.0, frame_rate=20, grid_spacing=SPACING, gravity=(0, 0, 0), transfer=transfer),
    )
    return rig.run(start, problem)


def turning(motion: Motion) -> Float64Array:
    """Return the plate's angular momentum about its middle (frame,), kg m2/s."""
    arms = motion.positions - np.array(MIDDLE)
    total: Float64Array = np.cross(arms, motion.velocities)[:, :, 1] @ motion.masses
    return total


def spin(rig: Rig) -> Iterator[Line]:
    """Frames hold no affine velocities. The first substeps give these their share of the momentum, then it stays."""
    motion = spinning_plate(rig)
    spins = turning(motion)
    error = float(np.abs(spins[2:] / spins[1] - 1).max())
    yield Line("angular momentum of a spinning plate, change", "", 0.0, error, 1e-3, "free rotation")
    energy = motion.kinetic_energy()
    yield Line("energy of a spinning plate, loss", "", 0.0, float(1 - energy[-1] / energy[1]), 1e-3, "free rotation")


def friction(rig: Rig) -> Iterator[Line]:
    """Kinetic, potential and elastic energy of a collapse only fall: friction, yield and transfers all dissipate."""
    motion = collapse.column(rig, 1.0, collapse.FRICTION_ANGLE)
    height = motion.mean(motion.positions)[:, 2]
    falling = motion.kinetic_energy() + motion.masses.sum() * collapse.GRAVITY * height
    energy = falling + elastic_energy(motion)
    rise = float(np.diff(energy).max(initial=0.0) / (energy[0] - energy[-1]))
    yield Line("energy of a collapse, largest rise to the release", "", 0.0, rise, 1e-3, "second law")


def elastic_energy(motion: Motion) -> Float64Array:
    """Return p^2 / 2K + q^2 / 6G over all volumes (frame,), J, with Kirchhoff's stress, conjugate to Hencky strain."""
    material, volumes = motion.problem.material, motion.filling.particle_volumes.astype(np.float64)
    energies = []
    for frame in motion.frames:
        mean, deviatoric = (values.astype(np.float64) for values in (frame.mean_stresses, frame.deviatoric_stresses))
        change = np.exp(2 * mean / material.bulk_modulus)  # of volume, squared
        density = mean**2 / (2 * material.bulk_modulus) + deviatoric**2 / (6 * material.shear_modulus)
        energies.append(float(volumes @ (change * density)))
    return np.array(energies)


CASES = (
    Case("budgets of a flying block", budgets, fast=True),
    Case("free spin", spin),
    Case("energy of a collapse", friction, fast=True),
)
