"""Invariants of stress from the elastic state."""

import numpy as np
import pytest

from slideframe.problem import Sand
from slideframe.stress import stress_invariants, symmetric
from slideframe.testing.solver_scenes import sand_problem

MATERIAL = Sand(friction_angle=30, density=2000, youngs_modulus=5e7, poisson_ratio=0.3)


def state_of(strain):
    """Return b_e - 1 of principal Hencky strains."""
    return np.diag(np.expm1(2 * np.array(strain, np.float64)))[None]


def test_small_strain_is_hookes_law():
    strain = np.array([-1e-5, 2e-6, 2e-6])
    mean, deviatoric = stress_invariants(state_of(strain), MATERIAL)
    stress = 2 * MATERIAL.shear_modulus * strain + MATERIAL.lame_lambda * strain.sum()
    assert mean[0] == pytest.approx(stress.mean(), rel=1e-4)
    assert deviatoric[0] == pytest.approx(stress[1] - stress[0], rel=1e-4)


def test_invariants_do_not_turn():
    state = state_of([-0.02, 0.01, 0.003])
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    np.testing.assert_allclose(
        np.ravel(stress_invariants(turn @ state @ turn.T, MATERIAL)), np.ravel(stress_invariants(state, MATERIAL))
    )


def test_cauchys_stress_is_over_the_changed_volume():
    mean, _ = stress_invariants(state_of([-0.1, -0.1, -0.1]), MATERIAL)
    assert mean[0] == pytest.approx(-0.3 * MATERIAL.bulk_modulus / np.exp(-0.3))


def test_crushed_particles_have_finite_stress():
    assert np.isfinite(stress_invariants(-np.eye(3)[None], MATERIAL)).all()


def test_components_fill_the_matrix():
    matrix = symmetric(np.arange(6, dtype=np.float32)[None])[0]
    np.testing.assert_array_equal(matrix, [[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def test_stress_is_off_by_default():
    assert not sand_problem().simulation.record_stress
