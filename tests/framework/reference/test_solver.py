"""What the reference must hold beyond the kit, since everything else is measured against it."""

import numpy as np

from slideframe.reference.solver import Particles, Stencil, bound_stretch, particles_to_grid
from slideframe.testing.solver_scenes import block_filling, filling_of, sand_problem

ROUNDING = 1e-12


def test_transfer_conserves_mass_and_both_momenta():
    """APIC conserves angular momentum too (Jiang et al. 2015); without stress the grid's equals the particles'."""
    random = np.random.default_rng(1)
    filling, problem = block_filling((1, 0.25, 0.5), (2, 0.75, 1)), sand_problem()
    grid = problem.grid(filling)
    state = Particles.at_start(filling, 2000)
    state.velocities = random.standard_normal(state.velocities.shape)
    state.velocity_gradients = random.standard_normal(state.velocity_gradients.shape)
    momentum, impulse, mass = particles_to_grid(state, Stencil.around(state.positions, grid), problem, grid, 1e-3)
    assert not impulse.any()
    nodes = np.indices(grid.shape).reshape(3, -1).T * grid.spacing + np.array(grid.origin)
    np.testing.assert_allclose(mass.sum(), state.masses.sum(), rtol=ROUNDING)
    carried = state.masses[:, None] * state.velocities
    np.testing.assert_allclose(momentum.sum(axis=0), carried.sum(axis=0), rtol=1e-10)
    # a particle's own spin is m dx^2/4 times the antisymmetric part of C
    spin = np.einsum("p,pij,kji->k", state.masses, state.velocity_gradients, _levi_civita()) * grid.spacing**2 / 4
    expected = np.cross(state.positions, carried).sum(axis=0) + spin
    np.testing.assert_allclose(np.cross(nodes, momentum).sum(axis=0), expected, rtol=1e-9)


def _levi_civita():
    symbol = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        symbol[i, j, k], symbol[i, k, j] = 1, -1
    return symbol


def test_splines_partition_unity_and_reproduce_linear_fields():
    positions = np.random.default_rng(2).uniform(0.1, 0.9, (100, 3))
    grid = sand_problem().grid(filling_of(np.float32([[0, 0, 1]]), 1.0))
    stencil = Stencil.around(positions, grid)
    np.testing.assert_allclose(stencil.weights.sum(axis=1), 1, rtol=ROUNDING)
    np.testing.assert_allclose(np.einsum("pn,pni->pi", stencil.weights, stencil.arms), 0, atol=ROUNDING)


def test_stretch_is_bounded_and_the_rest_untouched():
    gradients = np.stack([np.diag([4.0, 1.0, 0.1]), np.eye(3) * 1.3])
    kept = gradients[1].copy()
    bound_stretch(gradients)
    np.testing.assert_allclose(np.linalg.svd(gradients[0], compute_uv=False), [2.0, 1.0, 0.5])
    np.testing.assert_array_equal(gradients[1], kept)
