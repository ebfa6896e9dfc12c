"""Splats ride on particles as the ground about them moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.coupling import LEAST_STRETCH, MOST_STRETCH, Coupling, MovedSplats, clamp_stretch
from slideframe.errors import InputError
from slideframe.products import Filling, ParticleFrame, SplatCloud
from slideframe.rotations import rotation_matrices
from slideframe.singular_values import decompose, within

# float32 storage of quaternion and scales, relative to the largest entry of the covariance
COVARIANCE_TOLERANCE = 1e-5
# float32 positions of a scene ten metres wide
POSITION_TOLERANCE = 1e-5
# Jacobi in float64
DECOMPOSITION_TOLERANCE = 1e-12

PARTICLES = 6


def cloud(count: int, coefficients: int, seed: int) -> SplatCloud:
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(count, 4))
    return SplatCloud(
        centers=random.uniform(0, 10, (count, 3)).astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=random.uniform(0.02, 0.5, (count, 3)).astype(np.float32),
        opacities=random.uniform(0.1, 1, count).astype(np.float32),
        harmonics=random.normal(size=(count, coefficients, 3)).astype(np.float32),
    )


OBSERVED, INTERIOR = cloud(8, 4, 0), cloud(5, 1, 1)
CARRIERS = np.array([-1, 0, 2, -1, 5, 1, 1, -1], np.int32)


def filling() -> Filling:
    return Filling(
        bounds=np.array([[0.0, 0, 0], [10, 10, 10]]),
        particle_positions=np.random.default_rng(2).uniform(0, 10, (PARTICLES, 3)).astype(np.float32),
        particle_volumes=np.ones(PARTICLES, np.float32),
        interior=INTERIOR,
        interior_particles=np.array([0, 1, 2, 3, 4], np.int32),
        surface_particles=CARRIERS,
        surface_vertices=np.zeros((3, 3), np.float32),
        surface_triangles=np.zeros((1, 3), np.int32),
        surface_support=np.zeros(3, np.uint8),
    )


def frame(F: np.ndarray, positions: np.ndarray) -> ParticleFrame:
    gradients = np.broadcast_to(F, (PARTICLES, 3, 3)).astype(np.float32)
    positions = positions.astype(np.float32)
    return ParticleFrame(time=1.0, positions=positions, velocities=positions * 0, deformation_gradients=gradients)


def affine(F: np.ndarray, shift: np.ndarray) -> MovedSplats:
    start = filling().particle_positions
    return Coupling(OBSERVED, filling()).at(frame(F, start @ F.T + shift))


def covariances(rotations: np.ndarray, scales: np.ndarray) -> np.ndarray:
    axes = rotation_matrices(rotations.astype(np.float64)) * scales[:, None, :].astype(np.float64)
    return axes @ axes.transpose(0, 2, 1)


MOVING = np.r_[np.flatnonzero(CARRIERS >= 0), 8 + np.arange(5)]
REST_CENTERS = np.concatenate([OBSERVED.centers, INTERIOR.centers])
REST_COVARIANCES = covariances(
    np.concatenate([OBSERVED.rotations, INTERIOR.rotations]), np.concatenate([OBSERVED.scales, INTERIOR.scales])
)


def assert_affine(moved: MovedSplats, F: np.ndarray, shift: np.ndarray) -> None:
    np.testing.assert_allclose(moved.centers[MOVING], REST_CENTERS[MOVING] @ F.T + shift, atol=10 * POSITION_TOLERANCE)
    expected = F @ REST_COVARIANCES[MOVING] @ F.T
    found = covariances(moved.rotations, moved.scales)[MOVING]
    assert (np.abs(found - expected).max(axis=(1, 2)) <= COVARIANCE_TOLERANCE * np.abs(expected).max(axis=(1, 2))).all()


def test_rigid_rotation_turns_everything():
    R = rotation_matrices(np.array([[0.8, 0.3, -0.4, 0.2]]))[0]
    moved = affine(R, np.array([1.0, -2.0, 0.5]))
    assert_affine(moved, R.astype(np.float32).astype(float), np.array([1.0, -2.0, 0.5]))
    varied = np.flatnonzero(CARRIERS >= 0)  # the interior has one colour from everywhere
    np.testing.assert_allclose(moved.frame_rotations[varied], np.broadcast_to(R, (len(varied), 3, 3)), atol=1e-6)
    scales = np.concatenate([OBSERVED.scales, INTERIOR.scales])
    np.testing.assert_allclose(np.sort(moved.scales[MOVING]), np.sort(scales[MOVING]), rtol=COVARIANCE_TOLERANCE)


def test_pure_shear_gives_the_analytic_covariance():
    F = np.array([[1, 0, 0.625], [0, 1, 0], [0, 0, 1]])
    assert_affine(affine(F, np.zeros(3)), F, np.zeros(3))


def test_static_splats_keep_their_bits():
    moved = affine(np.diag([1.3, 0.9, 0.8]), np.ones(3))
    static = np.flatnonzero(CARRIERS < 0)
    for name in ("centers", "rotations", "scales", "opacities", "harmonics"):
        np.testing.assert_array_equal(getattr(moved, name)[static], getattr(OBSERVED, name)[static], err_msg=name)
    np.testing.assert_array_equal(moved.frame_rotations[static], np.broadcast_to(np.eye(3), (len(static), 3, 3)))


def test_the_first_frame_is_the_scan_to_the_bit():
    moved = affine(np.eye(3), np.zeros(3))
    np.testing.assert_array_equal(moved.centers, REST_CENTERS)
    np.testing.assert_array_equal(moved.scales, np.concatenate([OBSERVED.scales, INTERIOR.scales]))


def test_missing_coefficients_are_zero():
    moved = affine(np.eye(3), np.zeros(3))
    assert moved.harmonics.shape == (13, 4, 3)
    np.testing.assert_array_equal(moved.harmonics[8:, :1], INTERIOR.harmonics)
    assert not moved.harmonics[8:, 1:].any()


@pytest.mark.parametrize("F", [np.diag([1e4, 1, 1e-5]), np.zeros((3, 3)), np.diag([1, 1, -0.7])])
def test_stretch_is_bounded_whatever_happens(F):
    moved = affine(F, np.zeros(3))
    ratio = moved.scales[MOVING].max(axis=1) / np.concatenate([OBSERVED.scales, INTERIOR.scales])[MOVING].max(axis=1)
    assert (ratio <= MOST_STRETCH * (1 + 1e-5)).all()
    assert (ratio >= LEAST_STRETCH * (1 - 1e-5)).all()
    np.testing.assert_allclose(np.linalg.det(moved.frame_rotations.astype(float)), 1, atol=1e-5)
    assert np.isfinite(moved.rotations).all()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(-3, 1))
def test_decomposition_rebuilds_the_matrix(seed, log_spread):
    A = np.random.default_rng(seed).normal(size=(50, 3, 3)) * 10 ** np.array([0, log_spread, -log_spread])
    A[np.linalg.det(A) < 0] *= -1
    U, sigma, V = decompose(A)
    size = np.abs(A).max(axis=(1, 2), keepdims=True)
    assert np.abs((U * sigma[:, None]) @ V.transpose(0, 2, 1) - A).max() <= DECOMPOSITION_TOLERANCE * size.max()
    np.testing.assert_allclose(np.sort(sigma)[:, ::-1], np.linalg.svd(A)[1], rtol=1e-9, atol=1e-12 * size.max())
    np.testing.assert_allclose(U.transpose(0, 2, 1) @ U, np.broadcast_to(np.eye(3), U.shape), atol=1e-9)


def test_bounded_stretch_leaves_moderate_gradients_alone():
    F = np.eye(3) + 0.1 * np.random.default_rng(5).normal(size=(100, 3, 3))
    clamped, rotations = clamp_stretch(F)
    np.testing.assert_allclose(clamped, F, atol=1e-12)
    stretch = rotations.transpose(0, 2, 1) @ F
    np.testing.assert_allclose(stretch, stretch.transpose(0, 2, 1), atol=1e-12)


def test_products_of_another_run_are_refused():
    with pytest.raises(InputError, match="8 splats"):
        Coupling(INTERIOR, filling())
    one = np.zeros((1, 3), np.float32)
    other = ParticleFrame(
        time=0.0, positions=one, velocities=one, deformation_gradients=np.eye(3, dtype=np.float32)[None]
    )
    with pytest.raises(InputError, match="1 particles"):
        Coupling(OBSERVED, filling()).at(other)


@pytest.mark.parametrize(("share", "bare"), [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0), (40.0, 1.0)])
def test_the_interior_is_bare_once_its_particle_has_gone_its_own_width(share, bare):
    width = np.cbrt(filling().particle_volumes[0])
    moved = affine(np.eye(3), np.array([0.0, 0.0, -share * width]))
    np.testing.assert_allclose(moved.opacities[8:], bare * INTERIOR.opacities, rtol=1e-5)
    np.testing.assert_array_equal(moved.opacities[:8], OBSERVED.opacities)


def test_the_scar_stays_where_it_is_and_is_bare_once_the_ground_on_it_has_gone():
    below = cloud(3, 1, 7).model_copy(update={"centers": filling().particle_positions[:3] - np.float32([0, 0, 0.4])})
    below = SplatCloud(**{name: getattr(below, name)[:3] for name in SplatCloud.array_fields()})
    ground = filling().model_copy(update={"scar": below})
    coupling, start = Coupling(OBSERVED, ground), ground.particle_positions
    for way, bare in ((0.0, 0.0), (0.5, 0.5), (2.0, 1.0)):
        moved = coupling.at(frame(np.diag([1.2, 0.9, 1.0]), start + np.float32([way, 0, 0])))
        np.testing.assert_array_equal(moved.centers[13:], below.centers)
        np.testing.assert_array_equal(moved.scales[13:], below.scales)
        np.testing.assert_allclose(moved.opacities[13:], bare * below.opacities, rtol=1e-5)


def test_places_are_those_of_the_whole():
    coupling, start = Coupling(OBSERVED, filling()), filling().particle_positions
    random = np.random.default_rng(4)
    moment = frame(
        np.eye(3) + 0.5 * random.normal(size=(PARTICLES, 3, 3)), start + 0.3 * random.normal(size=start.shape)
    )
    centers, opacities = coupling.places_at(moment)
    np.testing.assert_array_equal(centers, coupling.at(moment).centers)
    np.testing.assert_array_equal(opacities, coupling.at(moment).opacities)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2))
def test_within_bounds_is_what_the_singular_values_say(seed, spread):
    A = np.eye(3) + spread * np.random.default_rng(seed).normal(size=(60, 3, 3))
    values = np.linalg.svd(A)[1]
    expected = (values.max(axis=1) < 2) & (values.min(axis=1) > 0.5) & (np.linalg.det(A) > 0)
    np.testing.assert_array_equal(within(A, 0.5, 2), expected)
