"""Problems that are one problem seen twice: moved by whole cells, with particles in another order, or turned."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Vector, Wall
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import filling, lattice

SPACING = 0.25
BOX = 2.0
GRAVITY: Vector = (2.0, -1.0, -9.81)
# In float64 what is left is the order of sums, and the rounding of float32 frames.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class View:
    """One way to look at the same slump: where it stands, in which order, and which way it faces."""

    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    order: int | None = None
    quarter_turns: int = 0

    def solve(self, rig: Rig) -> tuple[Float64Array, Float64Array]:
        """Return final positions and velocities as the plain view would have them."""
        positions, volume = lattice((0.0, 0.5, 0.0), (1.0, 1.25, 0.75), (8, 6, 6))
        centre = np.array([BOX / 2, BOX / 2, 0.0])
        turn = np.linalg.matrix_power(
            np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), self.quarter_turns
        )
        positions = (positions - centre) @ turn.T + centre + np.array(self.shift)
        sequence = np.arange(len(positions))
        if self.order is not None:
            sequence = np.random.default_rng(self.order).permutation(len(positions))
        box = (self.shift, tuple(np.array([BOX, BOX, BOX]) + self.shift))
        motion = rig.run(filling(positions[sequence], volume, box), slump(tuple(turn @ GRAVITY)))
        back = np.argsort(sequence)
        ends, speeds = motion.positions[-1][back], motion.velocities[-1][back]
        return (ends - self.shift - centre) @ turn + centre, speeds @ turn


def slump(gravity: Vector) -> SimulationProblem:
    """Return sand on a rough floor, in contact with a wall, that yields."""
    return SimulationProblem(
        material=Sand(friction_angle=30, density=2000, youngs_modulus=1e6, poisson_ratio=0.3),
        boundary=Boundary(floor=Wall(kind="friction", friction_angle=20.0)),
        simulation=Simulation(duration=0.2, frame_rate=5, grid_spacing=SPACING, gravity=gravity, precision="float64"),
    )


def invariance(view: View, name: str, rig: Rig) -> Iterator[Line]:
    """The largest difference of final places and velocities, to the largest displacement and velocity."""
    start, _ = lattice((0.0, 0.5, 0.0), (1.0, 1.25, 0.75), (8, 6, 6))
    (ends, speeds), (ends_, speeds_) = View().solve(rig), view.solve(rig)
    error = max(
        float(np.abs(ends - ends_).max() / np.abs(ends - start).max()),
        float(np.abs(speeds - speeds_).max() / np.abs(speeds).max()),
    )
    yield Line(f"a slump {name}: relative difference", "", 0.0, error, TOLERANCE, "metamorphic")


VIEWS = {
    "moved by three cells": View(shift=(3 * SPACING, -3 * SPACING, 3 * SPACING)),
    "with its particles in another order": View(order=7),
    "turned by a quarter about z": View(quarter_turns=1),
}
CASES = tuple(Case(f"a slump {name}", partial(invariance, view, name), fast=True) for name, view in VIEWS.items())
