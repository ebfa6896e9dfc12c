"""The compiled deformation, held to the float64 one, and its short cuts."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.coupling import Coupling, MovedSplats
from slideframe.products import Camera, Filling, ParticleFrame, SplatCloud
from slideframe.rotations import rotation_matrices
from slideframe_gs_torch.rasterize import rasterize
from slideframe_render_gs.moving_scene import MovingScene

# float32 storage of quaternion and scales, relative to the largest entry of the covariance
COVARIANCE_TOLERANCE = 1e-5
# where rounding lifts a splat over the alpha of 1/255 from which it is drawn
PICTURE_TOLERANCE = 6e-3
COUNT, PARTICLES = 60, 40
CAMERA = Camera(width=400, height=400, focal_x=200.0, focal_y=200.0, principal_x=200.0, principal_y=200.0)
POSE = np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0], [0, -30.0, 0]])


def cloud(seed: int, coefficients: int, count: int = COUNT) -> SplatCloud:
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(count, 4))
    return SplatCloud(
        centers=random.uniform(-4, 4, (count, 3)).astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=random.uniform(0.02, 0.5, (count, 3)).astype(np.float32),
        opacities=random.uniform(0.1, 1, count).astype(np.float32),
        harmonics=(0.3 * random.normal(size=(count, coefficients, 3))).astype(np.float32),
    )


OBSERVED = cloud(0, 16)


def filling() -> Filling:
    random = np.random.default_rng(1)
    return Filling(
        bounds=np.array([[-4.0, -4, -4], [4, 4, 4]]),
        particle_positions=random.uniform(-4, 4, (PARTICLES, 3)).astype(np.float32),
        particle_volumes=np.full(PARTICLES, 0.2, np.float32),
        interior=cloud(2, 1, 30),
        interior_particles=random.integers(0, PARTICLES, 30).astype(np.int32),
        surface_particles=random.integers(-1, PARTICLES, COUNT).astype(np.int32),
        surface_vertices=np.zeros((3, 3), np.float32),
        surface_triangles=np.zeros((1, 3), np.int32),
        surface_support=np.zeros(3, np.uint8),
        scar=cloud(3, 1, 10),
    )


def moment(seed: int, spread: float = 0.2) -> ParticleFrame:
    """Each particle is carried somewhere else by a deformation of its own; every fourth stays as it was."""
    random = np.random.default_rng(seed)
    start = filling().particle_positions
    moved = (np.arange(PARTICLES) % 4 > 0)[:, None]
    gradients = np.eye(3) + spread * random.normal(size=(PARTICLES, 3, 3)) * moved[..., None]
    return ParticleFrame(
        time=1.0,
        positions=(start + random.normal(size=start.shape) * moved).astype(np.float32),
        velocities=0 * start,
        deformation_gradients=gradients.astype(np.float32),
    )


def covariances(rotations: np.ndarray, scales: np.ndarray) -> np.ndarray:
    axes = rotation_matrices(rotations.astype(np.float64)) * scales[:, None, :].astype(np.float64)
    return axes @ axes.transpose(0, 2, 1)


def assert_as_the_reference(scene: MovingScene, coupling: Coupling, frame: ParticleFrame) -> None:
    seen, expected = scene.at(frame, CAMERA, POSE), coupling.at(frame)
    np.testing.assert_allclose(seen.centers, expected.centers, atol=1e-5)
    np.testing.assert_allclose(seen.opacities, expected.opacities, rtol=1e-5)
    shown = np.flatnonzero(expected.opacities > 1 / 255)
    mine, theirs = (covariances(m.rotations[shown], m.scales[shown]) for m in (seen, expected))
    size = np.abs(theirs).max(axis=(1, 2), keepdims=True)
    assert (np.abs(mine - theirs) <= COVARIANCE_TOLERANCE * size).all()
    # what has the same colour from everywhere need not turn
    varied = shown[expected.harmonics[shown, 1:].any(axis=(1, 2))]
    np.testing.assert_allclose(seen.frame_rotations[varied], expected.frame_rotations[varied], atol=1e-6)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.3, 1.0]))
def test_it_is_the_reference_s_deformation(seed, spread):
    """In and beyond the bounds of stretch, inverted particles among them."""
    coupling = Coupling(OBSERVED, filling())
    assert_as_the_reference(MovingScene(coupling), coupling, moment(seed, spread))


def test_pure_shear_gives_the_analytic_covariance():
    F = np.array([[1, 0, 0.625], [0, 1, 0], [0, 0, 1]])
    start = filling().particle_positions
    sheared = ParticleFrame(
        time=1.0,
        positions=(start @ F.T).astype(np.float32),
        velocities=0 * start,
        deformation_gradients=np.tile(F.astype(np.float32), (PARTICLES, 1, 1)),
    )
    seen = MovingScene(Coupling(OBSERVED, filling())).at(sheared, CAMERA, POSE)
    moving = filling().surface_particles >= 0
    expected = F @ covariances(OBSERVED.rotations, OBSERVED.scales)[moving] @ F.T
    found = covariances(seen.rotations, seen.scales)[:COUNT][moving]
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert (np.abs(found - expected) <= COVARIANCE_TOLERANCE * size).all()


def test_frames_in_any_order_leave_no_trace():
    """A scene that saw other frames before, and went back to rest, shows what a fresh one shows, bit for bit."""
    coupling = Coupling(OBSERVED, filling())
    used, start = MovingScene(coupling), filling().particle_positions
    gradients = np.tile(np.eye(3, dtype=np.float32), (PARTICLES, 1, 1))
    still = ParticleFrame(time=0.0, positions=start, velocities=0 * start, deformation_gradients=gradients)
    away = np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0], [0, 30.0, 0]])
    for frame, pose in ((moment(1), POSE), (moment(2), away), (moment(2), POSE), (still, away), (moment(3), POSE)):
        used.at(frame, CAMERA, pose)
    for frame in (moment(3), still, moment(4, 1.0)):
        assert_same_picture(used.at(frame, CAMERA, POSE), MovingScene(coupling).at(frame, CAMERA, POSE), POSE)


def assert_same_picture(mine: MovedSplats, theirs: MovedSplats, pose: np.ndarray) -> None:
    one, other = (
        rasterize(
            *map(torch.tensor, (m.centers, m.rotations, m.scales, m.opacities, m.harmonics)),
            camera=CAMERA, world_from_camera=pose, frame_rotations=m.frame_rotations,
        ).colour.numpy()
        for m in (mine, theirs)
    )  # fmt: skip
    np.testing.assert_allclose(one, other, atol=PICTURE_TOLERANCE)


def test_static_splats_and_the_scan_keep_their_bits():
    coupling = Coupling(OBSERVED, filling())
    seen = MovingScene(coupling).at(moment(5), CAMERA, POSE)
    static = np.flatnonzero(filling().surface_particles < 0)
    for name in ("centers", "rotations", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(seen, name)[static], getattr(OBSERVED, name)[static], err_msg=name)


@pytest.mark.parametrize("seed", range(5))
def test_splats_out_of_the_picture_may_be_old_but_none_in_it(seed):
    """From cameras amidst the splats, one after the other, the picture is that of the reference."""
    random, coupling = np.random.default_rng(seed), Coupling(OBSERVED, filling())
    scene = MovingScene(coupling)
    for step in range(3):
        pose = np.column_stack([rotation_matrices(random.normal(size=(1, 4)))[0], random.uniform(-5, 5, 3)])
        frame = moment(step % 2 + 10)
        assert_same_picture(scene.at(frame, CAMERA, pose), coupling.at(frame), pose)
    assert scene._stale.any()
