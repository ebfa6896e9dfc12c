"""What is particular to mpm_taichi; the rest is in the conformance kit and the agreement tests."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slideframe import guards
from slideframe.device import Device
from slideframe.errors import ConfigurationError, PluginError, StageFailed
from slideframe.testing.evidence import digest, fresh_context
from slideframe.testing.solver_scenes import block_filling, sand_problem
from slideframe.time_integration import Step
from slideframe_mpm_taichi import runtime
from slideframe_mpm_taichi.runtime import session
from slideframe_mpm_taichi.solver import TaichiSolver
from slideframe_mpm_taichi.stepper import Stepper

BLOCK = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))


def solve(problem, folder, filling=BLOCK):
    return list(TaichiSolver().solve(filling, problem, fresh_context(folder)))


def test_precisions_take_turns_in_one_process(tmp_path):
    single, double, again = (
        solve(sand_problem(precision=precision), tmp_path / str(turn))
        for turn, precision in enumerate(("float32", "float64", "float32"))
    )
    assert [digest(frame) for frame in single] == [digest(frame) for frame in again]
    assert digest(single[-1]) != digest(double[-1])


def test_nothing_is_written_to_stdout():
    program = (
        "from pathlib import Path; import tempfile\n"
        "from slideframe.testing.solver_scenes import block_filling, sand_problem\n"
        "from slideframe.testing.evidence import fresh_context\n"
        "from slideframe_mpm_taichi.solver import TaichiSolver\n"
        "block = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))\n"
        "list(TaichiSolver().solve(block, sand_problem(), fresh_context(Path(tempfile.mkdtemp()))))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""


def test_too_little_memory_is_refused_before_anything_is_allocated(tmp_path, monkeypatch):
    monkeypatch.setattr(guards, "available_memory", lambda: 60_000)  # a layer of cells fits, the rest does not
    with pytest.raises(ConfigurationError, match="GB are free"):
        solve(sand_problem(), tmp_path)


def test_a_lost_simulation_stops_and_names_the_particle(tmp_path):
    """A thousandfold stiffness behind the back of the time step's bound."""
    problem = sand_problem(duration=1.0)
    steady = problem.time_step(problem.grid(BLOCK))

    class Hasty(type(problem)):
        def time_step(self, grid):
            return steady

    stiff = problem.material.model_copy(update={"youngs_modulus": 1e9})
    hasty = Hasty.model_validate({**dict(problem), "material": stiff})
    with pytest.raises(StageFailed, match=r"particle \d+ at"):
        solve(hasty, tmp_path)


def test_a_shuffled_filling_moves_the_same(tmp_path):
    """Permutation: the order of particles changes the order of sums only."""
    order = np.random.default_rng(3).permutation(len(BLOCK.particle_positions))
    shuffled = BLOCK.model_copy(update={"particle_positions": BLOCK.particle_positions[order]})
    straight, mixed = solve(sand_problem(), tmp_path / "a")[-1], solve(sand_problem(), tmp_path / "b", shuffled)[-1]
    np.testing.assert_allclose(mixed.positions, straight.positions[order], atol=1e-5)


def test_other_settings_wait_for_a_running_simulation(tmp_path):
    """ti.init would destroy the memory of the first: an error, not a crash."""
    running = TaichiSolver().solve(BLOCK, sand_problem(), fresh_context(tmp_path, "running"))
    next(running), next(running)
    with pytest.raises(PluginError, match="still runs"):
        solve(sand_problem(precision="float64"), tmp_path)
    assert next(running).time == 0.2
    running.close()
    assert solve(sand_problem(precision="float64"), tmp_path / "after")


def test_threads_do_not_change_a_bit(tmp_path):
    program = (
        "import sys; from pathlib import Path; import tempfile; import taichi as ti\n"
        "from slideframe.testing.solver_scenes import block_filling, sand_problem\n"
        "from slideframe.testing.evidence import digest, fresh_context\n"
        "from slideframe_mpm_taichi.solver import TaichiSolver\n"
        "problem = sand_problem(gravity=(9.81, 0.0, -9.81), duration=0.8)\n"
        "block = block_filling((0.5, 0.0, 0.0), (5.0, 0.5, 0.5), size=(8.0, 1.0))\n"
        "frames = list(TaichiSolver().solve(block, problem, fresh_context(Path(tempfile.mkdtemp()))))\n"
        "sys.stderr.write(digest(frames[-1]))\n"
    )
    environment = {**os.environ, "TI_CPU_MAX_NUM_THREADS": "3", "ENABLE_TAICHI_HEADER_PRINT": "0"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    # on its slip floor the block crosses a dozen cells, so that slabs are cut anew many times
    problem = sand_problem(gravity=(9.81, 0.0, -9.81), duration=0.8)
    here = solve(problem, tmp_path, block_filling((0.5, 0.0, 0.0), (5.0, 0.5, 0.5), size=(8.0, 1.0)))
    assert (here[-1].positions - here[0].positions)[:, 0].mean() > 10 * 0.25
    assert done.stderr == digest(here[-1])


SLIDING = sand_problem(gravity=(9.81, 0.0, -9.81), duration=0.8)
LONG_BLOCK = block_filling((0.5, 0.0, 0.0), (5.0, 0.5, 0.5), size=(8.0, 1.0))


def test_the_code_for_cards_moves_the_same():
    """Where threads share nodes, sums are atomic and particles stay unsorted; here that runs on the processor."""

    def last(coloured):
        stepper = Stepper(LONG_BLOCK, SLIDING, SLIDING.grid(LONG_BLOCK), Device(), coloured=coloured)
        stepper.begin(Step(SLIDING.time_step(SLIDING.grid(LONG_BLOCK))[0], SLIDING.simulation.gravity))
        for _ in range(50):
            stepper.substep()
        return stepper.frame(0.0)

    with session(Device(), "float32"):
        mine, cards = last(coloured=True), last(coloured=False)
    np.testing.assert_allclose(cards.positions, mine.positions, atol=1e-5)
    np.testing.assert_allclose(cards.velocities, mine.velocities, atol=1e-4)
    np.testing.assert_allclose(cards.deformation_gradients, mine.deformation_gradients, atol=1e-4)


def test_nodes_follow_the_particles():
    """A block that slides for fifty cells through a box of ten thousand million nodes."""
    far = LONG_BLOCK.model_copy(update={"bounds": np.array([[0.0, 0.0, 0.0], [4000.0, 1000.0, 100.0]])})
    grid = SLIDING.grid(far)
    assert grid.node_count > 1e10
    with session(Device(), "float32"):
        stepper = Stepper(far, SLIDING, grid, Device())
        stepper.begin(Step(SLIDING.time_step(SLIDING.grid(far))[0], SLIDING.simulation.gravity))
        start = stepper.motion()[0]
        while (stepper.motion()[0] - start)[:, 0].mean() < 50 * 0.25:
            for _ in range(50):
                stepper.substep()
            assert stepper.layout.node_count < 100 * len(start)


def test_the_same_bits_are_promised_on_the_processor_only():
    stage = TaichiSolver(deterministic=True)
    stage.preflight(SLIDING, Device())
    with pytest.raises(ConfigurationError, match="--device cpu"):
        stage.preflight(SLIDING, Device("cuda", 0))
    TaichiSolver().preflight(SLIDING, Device("cuda", 0))


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="only Linux lists a process's threads there")
def test_every_core_has_a_worker_of_its_own():
    """Left to themselves, workers may share a core while another idles."""
    with session(Device(), "float32"):
        bound = [os.sched_getaffinity(int(thread.name)) for thread in Path("/proc/self/task").iterdir()]
    for core in os.sched_getaffinity(0):
        assert {core} in bound


def test_a_system_that_cannot_bind_threads_goes_without(monkeypatch):
    monkeypatch.setattr(runtime, "_threads", set)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    for precision in ("float64", "float32"):  # one of the two starts Taichi anew
        with session(Device(), precision):
            pass
