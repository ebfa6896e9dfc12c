"""Time steps, initial stress and the end of a simulation, in the reference and both backends."""

import numpy as np
import pytest

from slideframe.initial_stress import depths, elastic_state, geostatic_strain
from slideframe.problem import Elastic, Wall
from slideframe.reference.constitutive import kirchhoff_stress
from slideframe.reference.solver import ReferenceSolver
from slideframe.testing.evidence import fresh_context
from slideframe.testing.solver_scenes import block_filling, sand_problem

HEIGHT = 2.0
# Sudden gravity swings the top of a column with g H / c_p; a start in balance stays below this share of it.
STILL = 0.08


def column(**simulation):
    """A confined elastic column on a slip floor."""
    problem = sand_problem(duration=0.2, frame_rate=50.0)
    soil = Elastic(density=2000, youngs_modulus=1e6, poisson_ratio=0.3)
    settings = problem.simulation.model_copy(update={"time_step": "adaptive"} | simulation)
    return block_filling((0, 0, 0), (0.5, 0.5, HEIGHT), size=(0.5, 0.5)), problem.model_copy(
        update={"material": soil, "simulation": settings}
    )


def liveliness(frames, problem):
    """Greatest speed of the top, as a share of what sudden gravity causes."""
    top = frames[0].positions[:, 2] > HEIGHT - 0.25
    sudden = 9.81 * HEIGHT / problem.material.pressure_wave_speed
    return max(float(np.abs(frame.velocities[top, 2]).mean()) for frame in frames) / sudden


def test_sudden_gravity_swings_the_column(motion, solver):
    filling, problem = column()
    assert 0.5 < liveliness(motion(solver, filling, problem), problem) < 1.2


@pytest.mark.parametrize("kind", ["k0", "ramp"])
def test_a_column_in_balance_stands_still(motion, solver, kind):
    filling, problem = column(initial_stress=kind)
    frames = motion(solver, filling, problem)
    np.testing.assert_array_equal(frames[0].positions, filling.particle_positions)
    assert liveliness(frames, problem) < STILL


def test_geostatic_stress_is_the_weight_above_and_k0_times_it_across():
    filling, problem = column(initial_stress="k0", earth_pressure=0.6)
    hencky = geostatic_strain(filling, problem)
    values, vectors = np.linalg.eigh(hencky)
    stress = kirchhoff_stress((vectors * np.exp(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2), problem.material)
    weight = 2000 * 9.81 * (HEIGHT - filling.particle_positions[:, 2])
    np.testing.assert_allclose(stress[:, 2, 2], -weight, rtol=1e-4)
    np.testing.assert_allclose(stress[:, 0, 0], -0.6 * weight, rtol=1e-4)
    assert np.abs(stress[:, 0, 2]).max() < 1e-6 * weight.max()
    np.testing.assert_allclose(elastic_state(hencky)[:, 2], np.expm1(2 * hencky[:, 2, 2]), atol=1e-12)


def test_depth_is_measured_against_gravity_under_the_highest_of_each_column():
    filling = block_filling((0, 0, 0), (1, 0.5, 1))
    up = np.array([-np.sin(0.3), 0.0, np.cos(0.3)])
    tilted = depths(filling, up)
    positions = filling.particle_positions.astype(float)
    assert (tilted > 0).all()
    # the corner that lies deepest and the one that lies highest
    assert tilted[np.argmin(positions @ up)] > 0.8
    assert tilted[np.argmax(positions @ up)] == pytest.approx(0.0625)


def test_hold_test_is_reported(tmp_path):
    from slideframe.reference.solver import ReferenceSolver

    filling, problem = column(initial_stress="ramp")
    context = fresh_context(tmp_path)
    list(ReferenceSolver().solve(filling, problem, context))
    assert 0 < context.figures["hold_test_share_of_sudden_loading"] < STILL
    assert not context.warnings


def collapse(**simulation):
    problem = sand_problem(spacing=0.125, duration=1.2, frame_rate=5.0, floor=Wall(kind="stick"))
    settings = problem.simulation.model_copy(update={"time_step": "adaptive"} | simulation)
    return block_filling((0, 0, 0), (0.5, 0.25, 0.75), particle_spacing=0.0625, size=(3.0, 0.25)), problem.model_copy(
        update={"simulation": settings}
    )


def test_the_cells_across_the_mass_are_reported(tmp_path):
    filling, problem = column(duration=0.02)
    context = fresh_context(tmp_path)
    list(ReferenceSolver().solve(filling, problem, context))
    assert context.figures["cells_across_thickness"] == pytest.approx(HEIGHT / 0.25)


@pytest.mark.parametrize(("youngs_modulus", "told"), [(1e6, False), (1e5, True)])
def test_soil_too_soft_for_its_height_is_told(tmp_path, youngs_modulus, told):
    """rho g H / M: 2000 x 9.81 x 2 / 1.35e6 = 3 %, and ten times that."""
    filling, problem = column(duration=0.02)
    soil = problem.material.model_copy(update={"youngs_modulus": youngs_modulus})
    context = fresh_context(tmp_path)
    list(ReferenceSolver().solve(filling, problem.model_copy(update={"material": soil}), context))
    assert any("too soft" in warning and "0.291" in warning for warning in context.warnings) == told


def test_adaptive_steps_change_little_but_their_number(tmp_path):
    from slideframe_mpm_warp.solver import WarpSolver

    ends, substeps = {}, {}
    for kind in ("adaptive", "fixed"):
        filling, problem = collapse(time_step=kind)
        context = fresh_context(tmp_path, kind)
        frames = list(WarpSolver().solve(filling, problem, context))
        assert [frame.time for frame in frames] == [index / 5.0 for index in range(7)]
        ends[kind], substeps[kind] = frames[-1].positions.astype(float), context.figures["substeps"]
    assert substeps["adaptive"] < 0.95 * substeps["fixed"]
    moved = np.abs(ends["fixed"] - filling.particle_positions).mean()
    assert np.abs(ends["adaptive"].mean(axis=0) - ends["fixed"].mean(axis=0)).max() < 0.02 * moved


def test_a_mass_at_rest_ends_the_simulation(motion, solver):
    filling, problem = collapse(stop="rest", rest_share=0.2)
    frames = motion(solver, filling, problem)
    energies = [float((frame.velocities.astype(float) ** 2).sum()) for frame in frames]
    assert 3 <= len(frames) < problem.simulation.frame_count
    assert energies[-1] < 0.2 * max(energies)
    assert min(energies[1:-1]) >= 0.2 * max(energies[:2])


def test_backends_agree_from_a_start_under_stress(motion, backend):
    filling, problem = collapse(initial_stress="ramp", duration=0.4)
    mine, theirs = (motion(name, filling, problem)[-1] for name in (backend, "reference"))
    assert np.abs(mine.positions.mean(axis=0) - theirs.positions.mean(axis=0)).max() < 1e-3
