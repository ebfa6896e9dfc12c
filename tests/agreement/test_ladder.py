"""From fifty substeps to a whole collapse: both backends against the float64 reference and each other."""

import numpy as np
import pytest

from slideframe.problem import Wall
from slideframe.testing.solver_scenes import block_filling, sand_problem

# physics.md, "Agreement ladder".
MOMENTUM_TOLERANCE = 1e-5
FIELD_TOLERANCE = 1e-3
LONG_TOLERANCE_TO_REFERENCE = 0.02
LONG_TOLERANCE_BETWEEN = 0.01
# float64 in all three: what is left is the order of sums, and the rounding of float32 output.
FLOAT64_TOLERANCE = 1e-6


def relative(mine, theirs):
    return np.abs(mine - theirs).max() / np.abs(theirs).max()


def falling_block(precision="float32"):
    """A block that falls freely, is squeezed by nothing, and lasts some fifty substeps."""
    filling = block_filling((1.5, 0.75, 2.0), (2.5, 1.25, 2.5), size=(4.0, 2.0))
    return filling, sand_problem(duration=0.2, frame_rate=5.0, precision=precision, gravity=(1.0, -0.5, -9.81))


def standing_block(precision="float32"):
    """A block whose floor presses it: fifty substeps of stress, friction and yield."""
    rough = Wall(kind="friction", friction_angle=20.0)
    filling = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.75))
    return filling, sand_problem(
        duration=0.2, frame_rate=5.0, precision=precision, floor=rough, gravity=(2.0, 0.0, -9.81)
    )


def collapse(precision="float32"):
    """A column twice as high as wide, in a channel, on a rough floor."""
    rough = Wall(kind="friction", friction_angle=22.0)
    filling = block_filling((0.0, 0.0, 0.0), (0.5, 0.25, 1.0), size=(3.0, 0.25), particle_spacing=0.0625)
    return filling, sand_problem(
        spacing=0.125,
        duration=1.2,
        frame_rate=5.0,
        friction_angle=25,
        floor=rough,
        precision=precision,
    )


def test_fifty_substeps_without_contact(motion, backend):
    filling, problem = falling_block()
    _, substeps = problem.time_step(problem.grid(filling))
    assert 40 <= substeps <= 80
    mine, theirs = (motion(name, filling, problem)[-1] for name in (backend, "reference"))
    assert len(mine.positions) == len(filling.particle_positions)
    momentum = filling.particle_volumes.astype(np.float64) @ mine.velocities
    expected = filling.particle_volumes.sum(dtype=np.float64) * np.array(problem.simulation.gravity) * 0.2
    assert relative(momentum, expected) <= MOMENTUM_TOLERANCE
    assert relative(mine.velocities, theirs.velocities) <= FIELD_TOLERANCE


def test_fifty_substeps_in_contact(motion, backend):
    mine, theirs = (motion(name, *standing_block())[-1] for name in (backend, "reference"))
    assert relative(mine.positions, theirs.positions) <= FIELD_TOLERANCE
    assert relative(mine.velocities, theirs.velocities) <= FIELD_TOLERANCE
    assert relative(mine.deformation_gradients, theirs.deformation_gradients) <= FIELD_TOLERANCE


def test_float64_leaves_only_rounding(motion, backend):
    mine, theirs = (motion(name, *standing_block("float64"))[-1] for name in (backend, "reference"))
    assert relative(mine.velocities, theirs.velocities) <= FLOAT64_TOLERANCE
    assert relative(mine.deformation_gradients, theirs.deformation_gradients) <= FLOAT64_TOLERANCE


def deposit(frame):
    """Return the centre of mass, the front and the heights of a deposit in eight columns of 0.25 m."""
    x, z = frame.positions[:, 0].astype(np.float64), frame.positions[:, 2].astype(np.float64)
    column = np.minimum((x / 0.25).astype(int), 7)
    # mass per column is a profile that no single grain can spoil
    profile = np.bincount(column, minlength=8) / len(x)
    return np.array([x.mean(), z.mean()]), np.percentile(x, 99), profile


def assert_deposits_agree(mine, theirs, tolerance):
    (centre, front, profile), (centre_, front_, profile_) = deposit(mine), deposit(theirs)
    np.testing.assert_allclose(centre, centre_, rtol=tolerance)
    np.testing.assert_allclose(front, front_, rtol=tolerance)
    assert np.abs(profile - profile_).max() <= tolerance * profile_.max()


def test_collapse_agrees_with_the_reference(motion, backend):
    mine, theirs = (motion(name, *collapse())[-1] for name in (backend, "reference"))
    assert_deposits_agree(mine, theirs, LONG_TOLERANCE_TO_REFERENCE)


def test_collapse_agrees_between_backends(motion):
    mine, theirs = (motion(name, *collapse())[-1] for name in ("mpm_warp", "mpm_taichi"))
    assert_deposits_agree(mine, theirs, LONG_TOLERANCE_BETWEEN)


def test_a_stronger_sand_breaks_the_agreement(motion):
    """Negative control: three degrees of friction angle are no rounding."""
    filling, problem = collapse()
    stronger = problem.model_copy(update={"material": problem.material.model_copy(update={"friction_angle": 28.0})})
    with pytest.raises(AssertionError):
        assert_deposits_agree(
            motion("mpm_warp", filling, stronger)[-1],
            motion("mpm_warp", filling, problem)[-1],
            LONG_TOLERANCE_TO_REFERENCE,
        )
