"""Hold tests: soil that starts with the stress of its own weight must stay where it is."""

from collections.abc import Iterator
from functools import partial
from typing import Literal

import numpy as np

from slideframe.problem import Sand, Simulation, SimulationProblem
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import column

GRAVITY = 9.81
HEIGHT = 10.0
CELLS = 16
# The paper's sand. Elastic confinement would give K0 = 0.43 and yield; 1 - sin(phi) = 0.63 holds.
MATERIAL = Sand(friction_angle=22, density=2000, youngs_modulus=5e7, poisson_ratio=0.3)


def held_column(start: Literal["k0", "ramp"], rig: Rig) -> Iterator[Line]:
    """Peak speed in one period, as a share of that of a column that gravity loads at once, g H / c_p."""
    period = formulas.fundamental_period(HEIGHT, MATERIAL.pressure_wave_speed)
    simulation = Simulation(
        duration=period, frame_rate=20 / period, grid_spacing=HEIGHT / CELLS, initial_stress=start, record_stress=True
    )
    motion = rig.run(column(HEIGHT, CELLS), SimulationProblem(material=MATERIAL, simulation=simulation))
    shock = GRAVITY * HEIGHT / MATERIAL.pressure_wave_speed
    fastest = float(np.abs(motion.velocities[1:, :, 2]).max())
    name = f"column that starts with stress by {start}: speed to a shock's"
    yield Line(name, "", 0.0, fastest / shock, 0.05, "hold test")


CASES = (
    Case("hold test, k0", partial(held_column, "k0"), fast=True),
    Case("hold test, ramp", partial(held_column, "ramp")),
)
