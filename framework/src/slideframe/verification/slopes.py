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
from slideframe.problem import Boundary, DruckerPrager, Simulation, SimulationProblem, Wall
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.contact import GRAVITY, tilted_gravity
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import slice_of

HEIGHT = 1.0
FRAMES = 40
FRICTION_ANGLES = (22.0, 30.0, 35.0)
# above and below the critical angle, degrees
MARGIN = 2.0


@dataclass(frozen=True)
class Layer:
    """A layer on a slope, `cells` high and `length` long, m, for a time that no wave from its ends outruns, s."""

    soil: DruckerPrager
    angle: float
    cells: int = 4
    length: float = 60.0
    duration: float = 0.5

    def speed(self, rig: Rig) -> tuple[Float64Array, Float64Array]:
        """Return times (frame,), s, and the speed (frame,), m/s, down the slope of the upper middle."""
        spacing = HEIGHT / self.cells
        problem = SimulationProblem(
            material=self.soil,
            boundary=Boundary(floor=Wall(kind="stick")),
            simulation=Simulation(
                duration=self.duration,
                frame_rate=FRAMES / self.duration,
                grid_spacing=spacing,
                gravity=tilted_gravity(self.angle),
            ),
        )
        motion = rig.run(slice_of((0, 0), (self.length, HEIGHT), spacing, self.length), problem)
        start = motion.positions[0]
        middle = (np.abs(start[:, 0] - self.length / 2) < HEIGHT) & (start[:, 2] > HEIGHT / 2)
        return motion.times, motion.velocities[:, middle, 0].mean(axis=1)

    def final_speed(self, rig: Rig) -> float:
        """Return the last speed as a share of that of a free slide."""
        _, speed = self.speed(rig)
        return abs(float(speed[-1])) / (GRAVITY * math.sin(math.radians(self.angle)) * self.duration)

    def shear_ratio(self, rig: Rig) -> float:
        """Return shear to normal stress on planes parallel to the slope, by Newton's second law, once it flows."""
        times, speed = self.speed(rig)
        flowing = slice(FRAMES // 4, 3 * FRAMES // 4)
        slope = np.polynomial.Polynomial.fit(times[flowing], speed[flowing], 1).convert().coef[1]
        tilt = math.radians(self.angle)
        return float((math.sin(tilt) - slope / GRAVITY) / math.cos(tilt))


def soil(friction_angle: float, cohesion: float = 0.0) -> DruckerPrager:
    """Return a soil of Mohr-Coulomb's strength without dilatancy; cohesion in Pa."""
    return DruckerPrager(
        friction_angle=friction_angle, cohesion=cohesion, density=2000, youngs_modulus=1e7, poisson_ratio=0.3
    )


def stay_put(rig: Rig) -> Iterator[Line]:
    """Slopes a little less steep than critical come to rest."""
    for phi in FRICTION_ANGLES:
        angle = formulas.critical_slope(phi) - MARGIN
        got = Layer(soil(phi), angle).final_speed(rig)
        name = f"slope of {angle:.1f} degrees, phi {phi:g}: speed to free slide's"
        yield Line(name, "", 0.0, got, 0.01, "holds below atan(sin phi)")


def failing(rig: Rig) -> Iterator[Line]:
    """Slopes a little steeper shear with the strength of simple shear."""
    for phi in FRICTION_ANGLES:
        expected = math.sin(math.radians(phi))
        got = Layer(soil(phi), formulas.critical_slope(phi) + MARGIN).shear_ratio(rig)
        name = f"simple shear of phi {phi:g} without dilatancy: tau / sigma_n"
        yield Line(name, "", expected, got, 0.03 * expected, "Davis 1968: sin phi")


def safety(material: DruckerPrager, angle: float) -> float:
    """Return the factor of safety of a layer without dilatancy, whose planes carry c cos(phi) + sigma_n sin(phi)."""
    phi, beta = math.radians(material.friction_angle), math.radians(angle)
    return formulas.infinite_slope_safety(
        cohesion=material.cohesion * math.cos(phi),
        friction_angle=formulas.critical_slope(material.friction_angle),
        unit_weight=material.density * GRAVITY,
        depth=HEIGHT / math.cos(beta),
        slope=angle,
    )


def cohesive(rig: Rig) -> Iterator[Line]:
    """Cohesive soil shears at the base alone, in a zone of two cells: the strength is extrapolated to none."""
    holds, fails, angle = soil(30.0, 7500.0), soil(30.0, 3000.0), 40.0
    got = Layer(holds, angle, length=40.0, duration=0.3).final_speed(rig)
    name = f"cohesive slope of safety {safety(holds, angle):.2f}: speed to free slide's"
    yield Line(name, "", 0.0, got, 0.01, "Skempton and DeLory 1957, Davis 1968")
    coarse, fine = (Layer(fails, angle, cells=cells, length=40.0, duration=0.3).shear_ratio(rig) for cells in (4, 8))
    expected = safety(fails, angle) * math.tan(math.radians(angle))
    name = f"cohesive slope of safety {safety(fails, angle):.2f}: tau / sigma_n, extrapolated"
    yield Line(name, "", expected, 2 * fine - coarse, 0.03 * expected, "Skempton and DeLory 1957, Davis 1968")


CASES = (
    Case("slope that stays put", stay_put),
    Case("slope that fails", failing),
    Case("cohesive slope", cohesive),
)
