"""Collapses of plane columns against measurements."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Wall
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import slice_of

GRAVITY = 9.81
WIDTH = 1.0
# cells across the column's smaller side
CELLS = 8
# the sands of Lube et al. repose at 29.5 to 33 degrees
FRICTION_ANGLE = 30.0
# at this angle a collapse falls short of every band: that the bands can fail is part of the card
TOO_MUCH_FRICTION = 45.0
# the front is where the deposit is this thick, as a share of WIDTH: a single grain farther out doesn't count
FRONT_THICKNESS = 0.02


@dataclass(frozen=True)
class Deposit:
    """The thickness of a deposit, mass over density and area, in columns of one cell.

    Attributes:
        middles: of the columns (column,), m.
        thickness: (column,), m.
    """

    middles: Float64Array
    thickness: Float64Array

    @classmethod
    def of(cls, motion: Motion, frame: int = -1) -> "Deposit":
        """Measure a slice that stands on x = 0."""
        spacing = motion.problem.simulation.grid_spacing
        width = float(np.ptp(motion.filling.bounds[:, 1]))
        columns = (motion.positions[frame, :, 0] / spacing).astype(int)
        count = round(float(motion.filling.bounds[1, 0]) / spacing)
        heights = motion.filling.particle_volumes.astype(np.float64) / (spacing * width)
        thickness = np.zeros(count)
        np.add.at(thickness, columns, heights)
        middles = (np.arange(count, dtype=np.float64) + 0.5) * spacing
        return cls(middles, thickness)

    def front(self, thickness: float) -> float:
        """Return the farthest x, m, at which the deposit is that thick, linearly between the columns' middles."""
        last = int(np.nonzero(self.thickness >= thickness)[0][-1])
        if last + 1 == len(self.thickness):
            return float(self.middles[last])
        here, beyond = self.thickness[last], self.thickness[last + 1]
        share = (here - thickness) / (here - beyond)
        return float(self.middles[last] + share * (self.middles[last + 1] - self.middles[last]))


def column(rig: Rig, aspect_ratio: float, friction_angle: float) -> Motion:
    """Return a plane column that collapses on a rough floor until it lies."""
    height = aspect_ratio * WIDTH
    spacing = min(WIDTH, height) / CELLS
    duration = 4.0 * math.sqrt(height / GRAVITY)
    problem = SimulationProblem(
        material=Sand(
            friction_angle=friction_angle,
            friction_match="plane_strain",
            density=2000,
            youngs_modulus=5e5 * height,
            poisson_ratio=0.3,
        ),
        boundary=Boundary(floor=Wall(kind="stick")),
        simulation=Simulation(duration=duration, frame_rate=20 / duration, grid_spacing=spacing, record_stress=True),
    )
    length = math.ceil(WIDTH * (1.5 + 2.5 * aspect_ratio) / spacing) * spacing
    return rig.run(slice_of((0, 0), (WIDTH, height), spacing, length), problem)


def run_out(rig: Rig, aspect_ratio: float, friction_angle: float) -> float:
    """Return (L - L0) / L0 of a plane column."""
    motion = column(rig, aspect_ratio, friction_angle)
    return (Deposit.of(motion).front(FRONT_THICKNESS * WIDTH) - WIDTH) / WIDTH


def band(aspect_ratio: float) -> tuple[float, float]:
    """Return the middle and the half width of the accepted run-out; beyond a = 2 a continuum over-spreads."""
    if aspect_ratio == 2.0:
        return 3.0, 0.6
    expected = formulas.column_run_out(aspect_ratio)
    return expected, 0.2 * expected


def column_of(aspect_ratio: float, rig: Rig) -> Iterator[Line]:
    """Run-out of a column of sand."""
    expected, tolerance = band(aspect_ratio)
    got = run_out(rig, aspect_ratio, FRICTION_ANGLE)
    yield Line(f"plane column of a = {aspect_ratio:g}: run-out", "", expected, got, tolerance, "Lube et al. 2005")


def negative_control(aspect_ratio: float, rig: Rig) -> Iterator[Line]:
    """Run-out of a column of far too much friction, which must not pass."""
    expected, tolerance = band(aspect_ratio)
    got = run_out(rig, aspect_ratio, TOO_MUCH_FRICTION)
    missed = float(abs(got - expected) > tolerance)
    name = f"control: phi {TOO_MUCH_FRICTION:g} leaves the band of a = {aspect_ratio:g}"
    yield Line(name, "", 1.0, missed, 0.0, "the check can fail", note=f"run-out {got:.3f}")


CASES = (
    Case("plane column, a = 1", partial(column_of, 1.0), fast=True),
    Case("plane column, a = 0.5", partial(column_of, 0.5)),
    Case("plane column, a = 2", partial(column_of, 2.0)),
    Case("column of too much friction, a = 1", partial(negative_control, 1.0)),
    Case("column of too much friction, a = 0.5", partial(negative_control, 0.5)),
    Case("column of too much friction, a = 2", partial(negative_control, 2.0)),
)
