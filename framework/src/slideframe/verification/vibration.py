"""The fundamental vibration of a free elastic bar: period, energy, and how fast refinement removes the error."""

import math
from collections.abc import Iterator

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Elastic, Simulation, SimulationProblem
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import filling, lattice

LENGTH = 1.0
# peak speed as a share of the wave speed, which is the peak strain: small, so that linear theory holds
AMPLITUDE = 1e-3
# with nu = 0 the cross-section stays as it is, and the bar is one-dimensional
MATERIAL = Elastic(density=1000, youngs_modulus=1e6, poisson_ratio=0.0)
PERIOD = 2 * LENGTH / MATERIAL.pressure_wave_speed
# until the second time that all energy is kinetic
PERIODS = 1.5
FRAMES_PER_PERIOD = 80
CELLS = (8, 16, 32)


def bar(rig: Rig, cells: int) -> Motion:
    """Return a bar along x in free flight that starts with v = v0 cos(pi x / L), its ends' antinodes."""
    spacing = LENGTH / cells
    low = 2 * spacing
    positions, volume = lattice((low, low, low), (low + LENGTH, 2 * low, 2 * low), (2 * cells, 2, 2))
    velocities = np.zeros_like(positions)
    velocities[:, 0] = AMPLITUDE * MATERIAL.pressure_wave_speed * _shape(positions, low)
    box = ((0, 0, 0), (LENGTH + 2 * low, 3 * low, 3 * low))
    simulation = Simulation(
        duration=PERIODS * PERIOD,
        frame_rate=FRAMES_PER_PERIOD / PERIOD,
        grid_spacing=spacing,
        gravity=(0, 0, 0),
        precision="float64",
    )
    start = filling(positions, volume, box, particle_velocities=velocities.astype(np.float32))
    return rig.run(start, SimulationProblem(material=MATERIAL, simulation=simulation))


def _shape(positions: Float64Array, low: float) -> Float64Array:
    shape: Float64Array = np.cos(math.pi * (positions[:, 0] - low) / LENGTH)
    return shape


def period(motion: Motion) -> float:
    """Return the period, s, from the instants at which the mode's velocity changes sign."""
    shape = _shape(motion.positions[0], 2 * motion.problem.simulation.grid_spacing)
    amplitude = motion.velocities[:, :, 0] @ shape
    turns = np.nonzero(amplitude[:-1] * amplitude[1:] < 0)[0]
    before, after = amplitude[turns], amplitude[turns + 1]
    instants = motion.times[turns] + (motion.times[turns + 1] - motion.times[turns]) * before / (before - after)
    return 2 * float(np.polynomial.Polynomial.fit(np.arange(len(turns)), instants, 1).convert().coef[1])


def free_bar(rig: Rig) -> Iterator[Line]:
    """Period and energy on the finest grid, and the order of the period's error."""
    motions = [bar(rig, cells) for cells in CELLS]
    errors = [abs(period(motion) / PERIOD - 1) for motion in motions]
    got = period(motions[-1])
    yield Line("period of a free bar", "s", PERIOD, got, 0.002 * PERIOD, "d'Alembert: 2 L / c")
    order = math.log2(errors[-2] / errors[-1])
    name = f"order of its error, {CELLS[-2]} to {CELLS[-1]} cells"
    yield Line(name, "", 2.0, order, 0.15, "quadratic splines, central in time")
    # All energy is kinetic every half period. The start is left out: it has no affine velocities yet.
    energy = motions[-1].kinetic_energy()
    loss = 1 - float(energy[3 * FRAMES_PER_PERIOD // 2] / energy[FRAMES_PER_PERIOD // 2])
    yield Line("energy that it loses in a period", "", 0.0, loss, 1e-3, "elasticity loses none")


CASES = (Case("free vibration of a bar", free_bar, fast=True),)
