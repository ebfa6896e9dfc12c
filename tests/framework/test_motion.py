import numpy as np
import pytest

from slideframe.motion import main_direction, measure
from slideframe.problem import Sand, Simulation, SimulationProblem
from slideframe.products import Filling, ParticleFrame, SplatCloud


def block(start: np.ndarray) -> tuple[Filling, SimulationProblem]:
    """Soil of an eighth of a cubic metre at each place, 1600 kg/m3."""
    filling = Filling(
        bounds=np.array([[-9.0, -9, -9], [9, 9, 9]]),
        particle_positions=start,
        particle_volumes=np.full(len(start), 0.125, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.zeros(0, np.int32),
        surface_particles=np.zeros(0, np.int32),
        surface_vertices=np.zeros((0, 3), np.float32),
        surface_triangles=np.zeros((0, 3), np.int32),
        surface_support=np.zeros(0, np.uint8),
    )
    problem = SimulationProblem(
        material=Sand(friction_angle=30, density=1600, youngs_modulus=1e6, poisson_ratio=0.2),
        simulation=Simulation(duration=1, grid_spacing=1),
    )
    return filling, problem


def test_a_sliding_block_has_the_energies_of_mechanics():
    count = 200
    start = np.random.default_rng(0).uniform(0, 3, (count, 3)).astype(np.float32)
    filling, problem = block(start)
    frame = ParticleFrame(
        time=1.0,
        positions=start + np.float32([3, 4, -2]),
        velocities=np.tile(np.float32([0, 2, -1]), (count, 1)),
        deformation_gradients=np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
        escaped=2,
    )
    mass = count * 0.125 * 1600
    figures = measure(frame, filling, problem)
    assert figures.kinetic_energy_j == pytest.approx(0.5 * mass * 5)
    assert figures.potential_energy_j == pytest.approx(-mass * 9.81 * 2, rel=1e-6)
    assert figures.run_out_m == pytest.approx(5, rel=1e-6)
    assert figures.mean_displacement_m == pytest.approx(np.sqrt(29), rel=1e-6)
    assert figures.front_m == pytest.approx(5, rel=1e-4)  # the mass moves along (3, 4)
    assert figures.moving_mass_kg == pytest.approx(mass)
    assert figures.volume_outside_m3 == pytest.approx(count * 0.125)
    assert figures.fastest_m_per_s == pytest.approx(np.sqrt(5))
    assert figures.escaped_particles == 2


def test_what_stays_over_its_source_is_not_outside_and_what_creeps_does_not_move():
    start = np.random.default_rng(1).uniform(0, 3, (300, 3)).astype(np.float32)
    filling, problem = block(start)
    shift = np.zeros_like(start)
    shift[:100] = [30, 0, 0]  # a third leaves eastwards, the rest sinks a little
    shift[100:] = [0, 0, -0.2]
    velocities = np.tile(np.float32([0.01, 0, 0]), (300, 1))
    velocities[:100, 0] = 4
    frame = ParticleFrame(
        time=1.0,
        positions=start + shift,
        velocities=velocities,
        deformation_gradients=np.tile(np.eye(3, dtype=np.float32), (300, 1, 1)),
    )
    figures = measure(frame, filling, problem)
    assert figures.volume_outside_m3 == pytest.approx(100 * 0.125)
    assert figures.moving_mass_kg == pytest.approx(100 * 0.125 * 1600)
    assert 29 < figures.front_m < 31
    north = measure(frame, filling, problem, np.array([0.0, 1.0]))
    assert north.front_m == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(main_direction(frame, filling), [1, 0], atol=1e-6)
