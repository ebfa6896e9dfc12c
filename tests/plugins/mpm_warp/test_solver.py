"""What is particular to mpm_warp; the rest is in the conformance kit and the agreement tests."""

import subprocess
import sys

import numpy as np
import pytest

from slideframe import guards
from slideframe.device import Device
from slideframe.errors import ConfigurationError, StageFailed
from slideframe.testing.evidence import digest, fresh_context
from slideframe.testing.solver_scenes import block_filling, sand_problem
from slideframe.time_integration import Step
from slideframe_mpm_warp import cores
from slideframe_mpm_warp.runtime import kernels_in
from slideframe_mpm_warp.solver import WarpSolver
from slideframe_mpm_warp.stepper import Stepper

BLOCK = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))


def solve(problem, folder, filling=BLOCK):
    return list(WarpSolver().solve(filling, problem, fresh_context(folder)))


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
        "from slideframe_mpm_warp.solver import WarpSolver\n"
        "block = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))\n"
        "list(WarpSolver().solve(block, sand_problem(), fresh_context(Path(tempfile.mkdtemp()))))\n"
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


SLIDING = sand_problem(gravity=(9.81, 0.0, -9.81), duration=0.8)
LONG_BLOCK = block_filling((0.5, 0.0, 0.0), (5.0, 0.5, 0.5), size=(8.0, 1.0))


def test_threads_do_not_change_a_bit(tmp_path, monkeypatch):
    """On its slip floor the block crosses a dozen cells, so that the grid is laid anew many times."""
    monkeypatch.setattr(cores, "LEAST_PARTICLES_PER_CORE", 1)
    results = []
    for count in (1, 3):
        monkeypatch.setattr(cores.os, "sched_getaffinity", lambda _, count=count: set(range(count)))
        results.append(solve(SLIDING, tmp_path / str(count), LONG_BLOCK))
    assert (results[0][-1].positions - results[0][0].positions)[:, 0].mean() > 10 * 0.25
    assert [digest(frame) for frame in results[0]] == [digest(frame) for frame in results[1]]


def test_the_code_for_cards_moves_the_same(tmp_path):
    """Where threads share nodes, other functions scatter and gather; here they run on the processor."""

    def last(coloured):
        grid = SLIDING.grid(LONG_BLOCK)
        stepper = Stepper(LONG_BLOCK, SLIDING, grid, "cpu", coloured=coloured)
        stepper.begin(Step(SLIDING.time_step(SLIDING.grid(LONG_BLOCK))[0], SLIDING.simulation.gravity))
        for _ in range(50):
            stepper.substep()
        return stepper.frame(0.0)

    mine, cards = last(coloured=True), last(coloured=False)
    np.testing.assert_allclose(cards.positions, mine.positions, atol=1e-5)
    np.testing.assert_allclose(cards.velocities, mine.velocities, atol=1e-4)
    np.testing.assert_allclose(cards.deformation_gradients, mine.deformation_gradients, atol=1e-4)


def test_nodes_follow_the_particles(tmp_path):
    """A block that slides for fifty cells through a box of ten thousand million nodes."""
    far = LONG_BLOCK.model_copy(update={"bounds": np.array([[0.0, 0.0, 0.0], [4000.0, 1000.0, 100.0]])})
    grid = SLIDING.grid(far)
    assert grid.node_count > 1e10
    stepper = Stepper(far, SLIDING, grid, "cpu")
    stepper.begin(Step(SLIDING.time_step(SLIDING.grid(far))[0], SLIDING.simulation.gravity))
    start = stepper.motion()[0]
    while (stepper.motion()[0] - start)[:, 0].mean() < 50 * 0.25:
        for _ in range(50):
            stepper.substep()
        assert stepper.layout.node_count < 100 * len(start)


def test_the_same_bits_are_promised_on_the_processor_only():
    stage = WarpSolver(deterministic=True)
    stage.preflight(SLIDING, Device())
    with pytest.raises(ConfigurationError, match="--device cpu"):
        stage.preflight(SLIDING, Device("cuda", 0))
    WarpSolver().preflight(SLIDING, Device("cuda", 0))


def test_the_code_for_cards_compiles_without_a_card(tmp_path):
    """For NVIDIA's Hopper, with the compiler that Warp brings along; it has not run on one."""
    import warp as wp

    package = kernels_in("float32", "cpu", True, False)
    for name in ("layout", "boundaries", "transfers", "rendering"):
        module = sys.modules[f"{package.__name__}.{name}"]
        wp.compile_aot_module(module, arch=90, module_dir=tmp_path / name, strip_hash=False)
        assert list((tmp_path / name).glob("*.ptx")) + list((tmp_path / name).glob("*.cubin"))
