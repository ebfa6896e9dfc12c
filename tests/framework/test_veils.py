"""Hidden splats and the particles over them."""

import numpy as np

from slideframe.veils import NO_PARTICLE, particles_over


def test_the_nearest_particle_about_each_point_is_found():
    """On a lattice, against every distance: points on its border have their nearest one in the columns about them."""
    spacing = 0.5
    axes = [np.arange(0, 5, spacing), np.arange(-3, 2, spacing), np.arange(10, 13, spacing)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    random = np.random.default_rng(0)
    points = (lattice[random.integers(0, len(lattice), 200)] + random.uniform(-0.2, 0.2, (200, 3))).astype(np.float32)
    found = particles_over(points, lattice, spacing)
    distances = np.linalg.norm(points[:, None] - lattice[None], axis=2)
    np.testing.assert_allclose(distances[np.arange(200), found], distances.min(axis=1), rtol=1e-6)


def test_a_point_without_ground_over_or_under_it_has_none():
    particles = np.float32([[0, 0, 0], [1, 0, 0]])
    points = np.float32([[0.1, 0, -30], [9, 0, 0], [0, -7, 0]])
    assert particles_over(points, particles, 1.0).tolist() == [0, NO_PARTICLE, NO_PARTICLE]
    assert particles_over(points[:0], particles, 1.0).tolist() == []
    assert particles_over(points, particles[:0], 1.0).tolist() == [NO_PARTICLE] * 3
