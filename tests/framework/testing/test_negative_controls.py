"""The kit must be able to fail: solvers with one fault each, and the check that finds it."""

from typing import ClassVar

import numpy as np
import pytest

from slideframe.problem import Wall
from slideframe.products import ParticleFrame
from slideframe.reference.solver import ReferenceSolver
from slideframe.testing import check_stage, checks_for, parametrize_with_checks
from slideframe.testing.stage_checks import check_imports_without_its_backend


def run_check(stage, name):
    (check,) = [check for check in checks_for(stage) if check.name == name]
    check()


class Altered(ReferenceSolver):
    """The reference with its frames or its problem altered."""

    def problem(self, problem):
        return problem

    def frame(self, frame, problem):
        return frame

    def solve(self, filling, problem, context):
        for frame in super().solve(filling, self.problem(problem), context):
            yield self.frame(frame, problem)


class TooHeavy(Altered):
    def problem(self, problem):
        gravity = tuple(1.001 * component for component in problem.simulation.gravity)
        return problem.model_copy(update={"simulation": problem.simulation.model_copy(update={"gravity": gravity})})


class IgnoresStart(Altered):
    def solve(self, filling, problem, context):
        still = filling.model_copy(update={"particle_velocities": np.zeros((0, 3), np.float32)})
        yield from super().solve(still, problem, context)


class Frictionless(Altered):
    def problem(self, problem):
        return problem.model_copy(update={"material": problem.material.model_copy(update={"friction_angle": 0.5})})


class TooStiff(Altered):
    def problem(self, problem):
        stiff = problem.material.model_copy(update={"youngs_modulus": 1.2 * problem.material.youngs_modulus})
        return problem.model_copy(update={"material": stiff})


class IgnoresWalls(Altered):
    def problem(self, problem):
        boundary = problem.boundary.model_copy(update={"floor": Wall()})
        return problem.model_copy(update={"boundary": boundary})


class Late(Altered):
    def frame(self, frame, problem):
        return frame.model_copy(update={"time": frame.time * (1 + 1e-12)})


class Drifting(Altered):
    def frame(self, frame, problem):
        return frame.model_copy(update={"positions": frame.positions + np.float32(1e-4 * frame.time)})


class Aliasing(Altered):
    _buffers: ClassVar[dict] = {}

    def frame(self, frame, problem):
        buffer = self._buffers.setdefault(len(frame.positions), np.empty_like(frame.positions))
        buffer[:] = frame.positions
        return frame.model_copy(update={"positions": buffer})


class Forgetful(Altered):
    def frame(self, frame, problem):
        return ParticleFrame(
            time=frame.time,
            positions=frame.positions[:-1],
            velocities=frame.velocities[:-1],
            deformation_gradients=frame.deformation_gradients[:-1],
        )


class Restless(Altered):
    _random: ClassVar = np.random.default_rng(0)

    def frame(self, frame, problem):
        noise = 1e-7 * self._random.standard_normal(frame.velocities.shape)
        return frame.model_copy(update={"velocities": frame.velocities + noise.astype(np.float32)})


class NeverEscapes(Altered):
    def frame(self, frame, problem):
        return frame.model_copy(update={"escaped": 0})


@pytest.mark.parametrize(
    ("faulty", "check"),
    [
        (TooHeavy, "free_fall_is_a_parabola"),
        (IgnoresStart, "start_velocities_are_kept"),
        (Frictionless, "sand_collapses_as_the_reference"),
        (TooStiff, "column_settles_as_theory"),
        (IgnoresWalls, "walls_differ"),
        (Frictionless, "stress_is_recorded_on_request"),
        (Late, "frames_are_on_time"),
        (Drifting, "rest_stays_at_rest"),
        (Aliasing, "frames_own_their_arrays"),
        (Forgetful, "frames_are_valid"),
        (Restless, "two_runs_are_equal"),
        (NeverEscapes, "particles_at_the_edge_are_held"),
    ],
)
def test_the_kit_finds_a_fault(faulty, check):
    run_check(ReferenceSolver(), check)
    with pytest.raises(AssertionError):
        run_check(faulty(), check)


def test_a_writer_into_the_filling_is_found():
    class Writer(Altered):
        def solve(self, filling, problem, context):
            yield from super().solve(filling, problem, context)
            filling.particle_positions.flags.writeable or filling.particle_positions.base.__setitem__(0, 9)

    with pytest.raises(AssertionError, match="wrote into"):
        run_check(Writer(), "input_is_untouched")


def test_a_module_that_imports_its_backend_is_found(tmp_path):
    class NeedsNumpy(ReferenceSolver):
        backend = ("numpy",)

    NeedsNumpy.__module__, NeedsNumpy.__qualname__ = ReferenceSolver.__module__, ReferenceSolver.__qualname__
    with pytest.raises(AssertionError, match="numpy"):
        check_imports_without_its_backend(NeedsNumpy(), tmp_path)


def test_check_stage_lists_failures(monkeypatch):
    chosen = [
        check
        for check in checks_for(ReferenceSolver())
        if check.name in ("name_is_its_entry_point", "frames_are_on_time")
    ]
    monkeypatch.setattr("slideframe.testing.kit.checks_for", lambda stage: chosen)
    with pytest.raises(AssertionError, match="reference fails 1 checks:\nname_is_its_entry_point: no installed"):
        check_stage(ReferenceSolver())


def test_every_check_states_its_claim():
    assert all(check.claim.endswith(".") for check in checks_for(ReferenceSolver()))


def test_parametrize_names_stage_and_check():
    @parametrize_with_checks(ReferenceSolver())
    def example(check):
        check()

    (mark,) = example.pytestmark
    assert {check.stage.name for check in mark.args[1]} == {"reference"}
    assert mark.kwargs["ids"](mark.args[1][0]) == "reference-options_survive_json"
