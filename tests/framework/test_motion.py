import numpy as np
import pytest

from slideframe.motion import measure
from slideframe.problem import Sand, Simulation, SimulationProblem
from slideframe.products import Filling, ParticleFrame, SplatCloud


def test_a_sliding_block_has_the_energies_of_mechanics():
    count = 200
    start = np.random.default_rng(0).uniform(0, 3, (count, 3)).astype(np.float32)
    none = np.zeros((0, 3), np.float32)
    filling = Filling(
        bounds=np.array([[-9.0, -9, -9], [9, 9, 9]]),
        particle_positions=start,
        particle_volumes=np.full(count, 0.125, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.zeros(0, np.int32),
        surface_particles=np.zeros(0, np.int32),
        surface_vertices=none,
        surface_triangles=np.zeros((0, 3), np.int32),
        surface_support=np.zeros(0, np.uint8),
    )
    problem = SimulationProblem(
        material=Sand(friction_angle=30, density=1600, youngs_modulus=1e6, poisson_ratio=0.2),
        simulation=Simulation(duration=1, grid_spacing=1),
    )
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
    assert figures.fastest_m_per_s == pytest.approx(np.sqrt(5))
    assert figures.escaped_particles == 2
