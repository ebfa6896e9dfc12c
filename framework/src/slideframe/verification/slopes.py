"""Layers of cohesionless sand on a slope: simple shear under their own weight.

A long layer on a sticking floor shears like an infinite slope: the sliding planes carry tau = sigma_n sin(phi)
without dilatancy in plane strain, so it holds below atan(sin phi), and above it accelerates with
g (sin a - sin(phi) cos a). The middle is measured before anything from the layer's ends arrives there.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Wall
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.contact import GRAVITY, tilted_gravity
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import slice_of

HEIGHT = 1.0
LENGTH = 60.0
CELLS = 4
DURATION = 0.5
FRAMES = 40
FRICTION_ANGLES = (22.0, 30.0, 35.0)
# above and below the critical angle, degrees
MARGIN = 2.0


@dataclass(frozen=True)
class Layer:
    """The upper middle of a layer: times (frame,), s, and its speed down the slope (frame,), m/s."""

    angle: float
    times: Float64Array
    speed: Float64Array

    @property
    def shear_ratio(self) -> float:
        """Shear to normal stress on planes parallel to the slope, by Newton's second law, once it flows."""
        flowing = slice(FRAMES // 4, 3 * FRAMES // 4)
        slope = np.polynomial.Polynomial.fit(self.times[flowing], self.speed[flowing], 1).convert().coef[1]
        tilt = math.radians(self.angle)
        return float((math.sin(tilt) - slope / GRAVITY) / math.cos(tilt))


def layer(rig: Rig, friction_angle: float, angle: float, match: str = "plane_strain") -> Layer:
    """Return how the middle of a layer moves on a slope."""
    spacing = HEIGHT / CELLS
    problem = SimulationProblem(
        material=Sand.model_validate(
            {
                "friction_angle": friction_angle,
                "friction_match": match,
                "density": 2000,
                "youngs_modulus": 1e7,
                "poisson_ratio": 0.3,
            }
        ),
        boundary=Boundary(floor=Wall(kind="stick")),
        simulation=Simulation(
            duration=DURATION, frame_rate=FRAMES / DURATION, grid_spacing=spacing, gravity=tilted_gravity(angle)
        ),
    )
    motion = rig.run(slice_of((0, 0), (LENGTH, HEIGHT), spacing, LENGTH), problem)
    start = motion.positions[0]
    middle = (np.abs(start[:, 0] - LENGTH / 2) < HEIGHT) & (start[:, 2] > HEIGHT / 2)
    return Layer(angle, motion.times, motion.velocities[:, middle, 0].mean(axis=1))


def stay_put(rig: Rig) -> Iterator[Line]:
    """Slopes a little less steep than critical come to rest."""
    for phi in FRICTION_ANGLES:
        angle = formulas.critical_slope(phi) - MARGIN
        held = layer(rig, phi, angle)
        free = GRAVITY * math.sin(math.radians(angle)) * DURATION
        name = f"slope of {angle:.1f} degrees, phi {phi:g}: speed to free slide's"
        yield Line(name, "", 0.0, float(abs(held.speed[-1])) / free, 0.01, "holds below atan(sin phi)")


def failing(rig: Rig) -> Iterator[Line]:
    """Slopes a little steeper shear with the strength of simple shear."""
    for phi in FRICTION_ANGLES:
        expected = math.sin(math.radians(phi))
        got = layer(rig, phi, formulas.critical_slope(phi) + MARGIN).shear_ratio
        name = f"simple shear of phi {phi:g} without dilatancy: tau / sigma_n"
        yield Line(name, "", expected, got, 0.03 * expected, "Davis 1968: sin phi")


CASES = (Case("slope that stays put", stay_put), Case("slope that fails", failing))
