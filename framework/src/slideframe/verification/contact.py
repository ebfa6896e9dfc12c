"""Blocks on inclines: Coulomb's law at the walls. Gravity is tilted, not the floor.

A block that starts free of stress bounces on its elasticity at first, and the floor's normal impulse is then not
m g cos(theta) t alone but also m times the change of normal speed. Coulomb friction takes mu times that impulse, so
(change of sliding speed + mu * change of normal speed) / time is g (sin theta - mu cos theta) whatever the bounce.
"""

import math
from collections.abc import Iterator

import numpy as np

from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Vector, Wall
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import slice_of

GRAVITY = 9.81
SPACING = 0.125
FRAMES = 20
MU_22 = math.tan(math.radians(22.0))
# physics.md, "Block on an incline"
SLIDES = ((30.0, 0.2), (35.0, MU_22), (40.0, MU_22))
# Matter's analytic suite asks for this accuracy
COULOMB_TOLERANCE = 1e-3


def tilted_gravity(angle: float) -> Vector:
    """Return gravity of 9.81 m/s2 seen from a floor that falls towards +x by `angle` degrees."""
    tilt = math.radians(angle)
    return GRAVITY * math.sin(tilt), 0.0, -GRAVITY * math.cos(tilt)


def floor_of(friction: float) -> Wall:
    """Return a floor with a coefficient of friction, which may be 0."""
    return Wall(kind="friction", friction_angle=math.degrees(math.atan(friction))) if friction else Wall()


def slide(rig: Rig, angle: float, friction: float, duration: float = 0.5, youngs_modulus: float = 1e6) -> Motion:
    """Return a block of 1 m by 0.25 m, strong enough not to yield, on an incline."""
    travel = 0.5 * formulas.incline_acceleration(angle, friction) * duration**2
    length = math.ceil((2 + travel) / SPACING) * SPACING
    problem = SimulationProblem(
        material=Sand(friction_angle=60, density=2000, youngs_modulus=youngs_modulus, poisson_ratio=0.3),
        boundary=Boundary(floor=floor_of(friction)),
        simulation=Simulation(
            duration=duration, frame_rate=FRAMES / duration, grid_spacing=SPACING, gravity=tilted_gravity(angle)
        ),
    )
    return rig.run(slice_of((0.5, 0), (1.5, 0.25), SPACING, length), problem)


def acceleration(motion: Motion, friction: float) -> float:
    """Return the mean acceleration along the floor, m/s2, with the bounce taken out."""
    velocity = motion.mean(motion.velocities)
    change = velocity[-1] - velocity[2]
    return float((change[0] + friction * change[2]) / (motion.times[-1] - motion.times[2]))


def coulomb_blocks(rig: Rig) -> Iterator[Line]:
    """Three angles and coefficients."""
    for angle, friction in SLIDES:
        expected = formulas.incline_acceleration(angle, friction)
        got = acceleration(slide(rig, angle, friction), friction)
        name = f"block on {angle:g} degrees, mu = {friction:.3f}: acceleration"
        yield Line(name, "m/s2", expected, got, COULOMB_TOLERANCE * expected, "Coulomb: g (sin a - mu cos a)")


def frictionless_block(rig: Rig) -> Iterator[Line]:
    """The speed that a fall through the same height gives."""
    # A step takes the speed at its end to move, which lengthens the way by one step in all: long slides hide that.
    motion = slide(rig, 30.0, 0.0, duration=1.0)
    drop = (motion.mean(motion.positions)[-1, 0] - motion.mean(motion.positions)[0, 0]) * math.sin(math.radians(30.0))
    got = motion.mean(motion.velocities)[-1, 0] / math.sqrt(2 * GRAVITY * drop)
    yield Line("frictionless slide: speed to sqrt(2 g h)", "", 1.0, float(got), COULOMB_TOLERANCE, "Galilei")


def sticking_block(rig: Rig) -> Iterator[Line]:
    """20 degrees are less than the 22 of the floor; what the bounce lets slip is the tolerance."""
    motion = slide(rig, 20.0, MU_22, youngs_modulus=1e7)
    free = 0.5 * GRAVITY * math.sin(math.radians(20.0)) * motion.times[-1] ** 2
    slipped = float(np.abs(motion.mean(motion.positions)[-1, 0] - motion.mean(motion.positions)[0, 0]))
    name = "block on 20 degrees, mu = tan 22: slip to a free slide's"
    yield Line(name, "", 0.0, slipped / free, 0.01, "Coulomb: sticks if tan a <= mu")


def long_slide(rig: Rig) -> Iterator[Line]:
    """Forty metres of sliding."""
    motion = slide(rig, 30.0, 0.2, duration=5.0)
    expected = formulas.incline_acceleration(30.0, 0.2)
    got = acceleration(motion, 0.2)
    yield Line(
        "block on 30 degrees, mu = 0.2, for 5 s: acceleration", "m/s2", expected, got, 1e-3 * expected, "Coulomb"
    )


CASES = (
    Case("block on a frictional incline", coulomb_blocks, fast=True),
    Case("block on a frictionless incline", frictionless_block),
    Case("block that sticks on an incline", sticking_block),
    Case("long slide", long_slide),
)
