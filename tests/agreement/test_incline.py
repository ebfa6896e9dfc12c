"""A block of sand slides on a tilted floor as Coulomb says: a = g (sin theta - mu cos theta)."""

import math

import numpy as np
import pytest

from slideframe.problem import Wall
from slideframe.testing.solver_scenes import block_filling, sand_problem

# The block starts free of stress, so its weight on the floor oscillates about the mean at first.
ACCELERATION_TOLERANCE = 0.03
CREEP_TOLERANCE_M = 1e-3
MU_22 = math.tan(math.radians(22.0))


def slide(motion, solver, angle, wall):
    """Return the mean acceleration along the floor between 0.2 and 0.6 s, m/s2; gravity is tilted, not the floor."""
    tilt = math.radians(angle)
    # strong sand, so that the block slides whole; low, so that it doesn't tip
    problem = sand_problem(
        duration=0.6,
        frame_rate=10.0,
        friction_angle=60.0,
        gravity=(9.81 * math.sin(tilt), 0.0, -9.81 * math.cos(tilt)),
        floor=wall,
    )
    frames = motion(solver, block_filling((1.0, 0.0, 0.0), (3.0, 0.5, 0.25), size=(6.0, 0.5)), problem)
    speed = [float(frame.velocities[:, 0].mean(dtype=np.float64)) for frame in frames]
    return (speed[6] - speed[2]) / 0.4, float((frames[-1].positions - frames[0].positions)[:, 0].mean())


@pytest.mark.parametrize(
    ("angle", "friction", "expected"),
    # physics.md, "Block on an incline", g = 9.81 m/s2
    [(30, 0.2, 3.205858), (35, MU_22, 2.380078), (40, MU_22, 3.269531)],
)
def test_acceleration_follows_coulomb(motion, solver, angle, friction, expected):
    wall = Wall(kind="friction", friction_angle=math.degrees(math.atan(friction)))
    acceleration, _ = slide(motion, solver, angle, wall)
    assert acceleration == pytest.approx(expected, rel=ACCELERATION_TOLERANCE)


def test_slip_floor_holds_nothing(motion, solver):
    acceleration, _ = slide(motion, solver, 30, Wall())
    assert acceleration == pytest.approx(9.81 * 0.5, rel=1e-3)


def test_block_sticks_below_the_friction_angle(motion, solver):
    _, moved = slide(motion, solver, 15, Wall(kind="friction", friction_angle=30.0))
    assert abs(moved) <= CREEP_TOLERANCE_M
