"""What one particle's faulty numbers do to the steppers of both backends."""

from contextlib import contextmanager, nullcontext

import numpy as np
import pytest

from slideframe.device import Device
from slideframe.testing.solver_scenes import block_filling, sand_problem
from slideframe.time_integration import Step
from slideframe_mpm_taichi.runtime import session
from slideframe_mpm_taichi.stepper import Stepper as TaichiStepper
from slideframe_mpm_warp.stepper import Stepper as WarpStepper

BLOCK = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))
FAULTY = 7


@contextmanager
def stepper_with(backend, particles):
    """Give the block's stepper at the start of a step, with some of its particles' arrays assigned."""
    problem = sand_problem()
    build, device, running = {
        "mpm_warp": (WarpStepper, "cpu", nullcontext()),
        "mpm_taichi": (TaichiStepper, Device(), session(Device(), "float32")),
    }[backend]
    with running:
        stepper = build(BLOCK, problem, problem.grid(BLOCK), device)
        for name, values in particles.items():
            stepper.particles.assign(name, values)
        stepper.begin(Step(1e-4, problem.simulation.gravity))
        yield stepper


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_nan_in_one_component_is_seen_at_once(backend, axis):
    """Maxima pass over NaN: it must not hide behind the other two components."""
    velocities = np.zeros((len(BLOCK.particle_positions), 3))
    velocities[FAULTY, axis] = np.nan
    with stepper_with(backend, {"velocities": velocities}) as stepper:
        assert not stepper.substep() < 1e6


def twenty_substeps_with(backend, gradient):
    """Return the motion and the total deformation gradients of the block, of which one is `gradient` at first."""
    gradients = np.tile(np.eye(3), (len(BLOCK.particle_positions), 1, 1))
    gradients[FAULTY] = gradient
    with stepper_with(backend, {"deformation_gradients": gradients}) as stepper:
        for _ in range(20):
            stepper.substep()
        return *stepper.motion(), stepper.frame(0.0).deformation_gradients


def test_a_particle_turned_inside_out_is_drawn_so_and_moves_no_other(backend):
    """Stress follows from the elastic strain, which is symmetric and has no sign to lose."""
    positions, velocities, _ = twenty_substeps_with(backend, np.eye(3))
    inverted_positions, inverted_velocities, gradients = twenty_substeps_with(backend, np.diag([-1.0, 1.0, 1.0]))
    np.testing.assert_array_equal(inverted_positions, positions)
    np.testing.assert_array_equal(inverted_velocities, velocities)
    assert np.flatnonzero(np.linalg.det(gradients.astype(float)) < 0).tolist() == [FAULTY]
