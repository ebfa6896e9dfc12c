"""Bad starts and lost simulations are named before or as soon as they harm."""

from dataclasses import replace

import numpy as np
import pytest

from slideframe import guards
from slideframe.errors import ConfigurationError, InputError, StageFailed
from slideframe.problem import Boundary, Domain
from slideframe.reference.solver import ReferenceSolver
from slideframe.testing.evidence import fresh_context
from slideframe.testing.solver_scenes import block_filling, filling_of, sand_problem
from slideframe.time_integration import March


def test_particles_outside_are_named():
    filling = block_filling((3.5, 0.0, 0.0), (4.5, 0.5, 0.5))
    with pytest.raises(InputError, match=r"64 of 128 particles.*particle 64 at \(4\.062"):
        guards.check_start(filling, sand_problem())


def test_particles_on_the_wall_are_inside():
    filling = filling_of(np.float32([[0, 0, 0], [4, 1, 3]]), 1e-3)
    assert guards.check_start(filling, sand_problem()).spacing == 0.25


def test_a_volume_of_zero_is_named():
    filling = block_filling((0, 0, 0), (1, 1, 0.5))
    volumes = filling.particle_volumes.copy()
    volumes[7] = 0
    with pytest.raises(InputError, match="particle 7"):
        guards.check_start(filling.model_copy(update={"particle_volumes": volumes}), sand_problem())


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["particle_positions", "particle_velocities"])
def test_places_and_velocities_must_be_finite(name, value):
    filling = block_filling((0, 0, 0), (1, 1, 0.5))
    values = filling.particle_positions.copy() if name == "particle_positions" else filling.start_velocities().copy()
    values[9, 1] = value
    with pytest.raises(InputError, match=rf"1 of 256 particles have {name} that aren't finite.*particle 9") as told:
        guards.check_start(filling.model_copy(update={name: values}), sand_problem())
    assert told.value.where == f"filling.{name}"


def test_walls_inside_the_mass_are_refused():
    filling, problem = block_filling((0, 0, 0), (1, 1, 0.5)), sand_problem()
    cut = Boundary(domain=Domain(x_min=0.5, x_max=4.0))
    with pytest.raises(InputError, match=r"\d+ of 256 particles lie outside the domain's walls"):
        guards.check_start(filling, problem.model_copy(update={"boundary": cut}))
    guards.check_start(filling, problem.model_copy(update={"boundary": Boundary(domain=Domain(margin=1.0))}))


def test_cells_larger_than_the_region_are_refused():
    with pytest.raises(ConfigurationError, match="two cells"):
        guards.check_start(block_filling((0, 0, 0), (1, 1, 0.5)), sand_problem(spacing=0.6))


def test_too_much_memory_is_refused():
    with pytest.raises(ConfigurationError, match=r"about 9000\.0 GB"):
        guards.check_memory(9e12, 10, 100)
    guards.check_memory(1e6, 10, 100)


def test_physical_memory_is_the_answer_without_proc(monkeypatch):
    monkeypatch.setattr(guards.Path, "read_text", lambda *args, **kwargs: (_ for _ in ()).throw(OSError()))
    assert guards.available_memory() > 1e8


@pytest.mark.parametrize("speed", [np.nan, np.inf, 1e6])
def test_a_lost_particle_is_named(speed):
    grid = sand_problem().grid(filling_of(np.zeros((1, 3), np.float32), 1.0))
    velocities = np.zeros((5, 3))
    velocities[3, 1] = speed
    with pytest.raises(StageFailed, match=r"particle 3 at \(0\.000, 0\.000, 0\.000\) m.*\n.*t = 0\.25 s"):
        guards.check_motion(np.zeros((5, 3)), velocities, 0.25, grid, 1e-3)


def test_frames_before_a_failure_are_kept(tmp_path):
    """Gravity of a neutron star: the first substeps hold, the next ones don't."""
    problem = sand_problem(duration=0.1, frame_rate=1000.0)
    wild = problem.model_copy(
        update={"simulation": problem.simulation.model_copy(update={"gravity": (0.0, 0.0, -1e6)})}
    )
    steady = problem.time_step(problem.grid(filling_of(np.float32([[0, 0, 1]]), 1.0)))

    class Hasty(type(wild)):
        def time_step(self, grid):
            return steady

    hasty = Hasty.model_construct(**dict(wild))
    frames = ReferenceSolver().solve(block_filling((1, 0.25, 0.5), (2, 0.75, 1)), hasty, fresh_context(tmp_path))
    assert next(frames).time == 0
    with pytest.raises(StageFailed, match="blew up"):
        list(frames)


def test_cells_that_no_memory_can_hold_are_refused_before_the_surface_is_known():
    with pytest.raises(ConfigurationError, match=r"particles, which need at least .* GB: more than"):
        guards.check_spacing((1000.0, 1000.0), sand_problem(spacing=0.005).simulation)
    guards.check_spacing((100.0, 100.0), sand_problem(spacing=0.5).simulation)


def test_more_particles_than_memory_can_hold_are_refused_before_they_are_laid(monkeypatch):
    monkeypatch.setattr(guards, "available_memory", lambda: 24_000_000_000)
    with pytest.raises(ConfigurationError, match=r"17,800 m3 would be 1,139,200,000 particles 0\.025 m apart") as told:
        guards.check_particles(17_800.0, 0.025)
    assert told.value.where == "simulation.grid_spacing"
    guards.check_particles(17_800.0, 0.1)


def test_the_fastest_of_the_lost_is_named():
    grid = sand_problem().grid(filling_of(np.zeros((1, 3), np.float32), 1.0))
    velocities = np.zeros((5, 3))
    velocities[1, 0], velocities[4, 0] = 1e4, 1e5
    with pytest.raises(StageFailed, match=r"particle 4 .* speed 100000 m/s, 2 of 5 particles"):
        guards.check_motion(np.zeros((5, 3)), velocities, 0.25, grid, 1e-3)


def test_a_long_frame_tells_how_far_it_is(tmp_path, monkeypatch):
    """With the ramp before t = 0 too, so that no long stage is silent."""
    monkeypatch.setattr(guards, "QUIET_SECONDS", 0.0)
    told = []
    context = replace(fresh_context(tmp_path), on_progress=lambda done, total, figures: told.append((done, figures)))
    problem = sand_problem(duration=0.1, frame_rate=10.0)
    settled = problem.simulation.model_copy(update={"initial_stress": "ramp"})
    block = block_filling((1, 0.25, 0.5), (1.5, 0.5, 0.75))
    list(ReferenceSolver().solve(block, problem.model_copy(update={"simulation": settled}), context))
    times = [figures["simulated_s"] for _, figures in told]
    assert times == sorted(times)
    assert times[0] < 0
    assert len(times) > 10
    within = [(done, figures) for done, figures in told if 0 < done < 1]
    assert within
    assert all({"substeps_per_second", "time_step_s", "remaining_s", "fastest_m_per_s"} <= set(f) for _, f in within)


@pytest.mark.parametrize("gravity", [-9.81, -9e3])
def test_steps_of_a_runaway_are_bounded_from_below(gravity):
    """What is faster than a cell per step of a free fall stops the run, so no frame takes steps without end."""
    problem = sand_problem(gravity=(0.0, 0.0, gravity), time_step="adaptive", frame_rate=25.0)
    grid = problem.grid(block_filling((1, 0.25, 0.5), (1.5, 0.5, 0.75)))
    fall_step = problem.time_step(grid)[0]
    march = March(block_filling((1, 0.25, 0.5), (1.5, 0.5, 0.75)), problem, grid, None)
    march.speed = grid.spacing / fall_step
    wave, gained = problem.material.pressure_wave_speed, abs(gravity) / 25
    shortest = march._longest_step(march._speed_bound())
    assert shortest >= 0.4 * grid.spacing / (1.05 * wave + march.speed + gained)
    assert shortest > fall_step / 20
