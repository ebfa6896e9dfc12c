import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from slideframe.harmonics import basis, rotate_harmonics

SEEDS = st.integers(0, 10_000)
# Float32 coefficients of size 1 pass through float64 matrices of condition up to 24.
ROUNDING = 5e-6


def colours(harmonics: np.ndarray, directions: np.ndarray) -> np.ndarray:
    functions = basis(directions)[..., : harmonics.shape[1]]
    return np.einsum("nk,nkc->nc", functions, harmonics)


def directions(random: np.random.Generator, count: int) -> np.ndarray:
    drawn = random.normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def test_the_functions_are_orthonormal_over_the_sphere():
    # Gauss-Legendre in height and even steps in azimuth integrate products up to degree 6 exactly
    height, weight = np.polynomial.legendre.leggauss(8)
    azimuth = 2 * np.pi * np.arange(16) / 16
    z, a = (grid.ravel() for grid in np.meshgrid(height, azimuth, indexing="ij"))
    radius = np.sqrt(1 - z**2)
    functions = basis(np.stack([radius * np.cos(a), radius * np.sin(a), z], axis=1))
    weights = np.repeat(weight, 16) * 2 * np.pi / 16
    assert functions.T @ (weights[:, None] * functions) == pytest.approx(np.eye(16), abs=1e-12)


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
@given(seed=SEEDS)
def test_turned_splats_show_the_colour_that_the_splats_show_from_the_turned_side(coefficients, seed):
    random = np.random.default_rng(seed)
    harmonics = random.normal(size=(20, coefficients, 3)).astype(np.float32)
    rotations = Rotation.random(20, random_state=seed).as_matrix()
    seen = directions(random, 20)
    turned = rotate_harmonics(harmonics, rotations)
    back = np.einsum("nji,nj->ni", rotations, seen)
    np.testing.assert_allclose(colours(turned, seen), colours(harmonics, back), atol=ROUNDING)
    one = rotate_harmonics(harmonics, rotations[0])
    np.testing.assert_allclose(one[0], turned[0], atol=ROUNDING)


def test_no_rotation_changes_nothing_visible():
    harmonics = np.random.default_rng(3).normal(size=(5, 16, 3)).astype(np.float32)
    np.testing.assert_allclose(rotate_harmonics(harmonics, np.eye(3)), harmonics, atol=ROUNDING)
