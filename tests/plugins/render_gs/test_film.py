"""Films of moving splats."""

from pathlib import Path

import numpy as np
import pytest
import torch

from slideframe.coupling import Coupling, rotation_matrices
from slideframe.device import Device
from slideframe.problem import View
from slideframe.products import Camera, Filling, ParticleFrame, SplatCloud
from slideframe.stages import Context
from slideframe.testing.ground_scenes import hillside_survey
from slideframe_gs_torch.harmonics import evaluate_harmonics
from slideframe_gs_torch.rasterize import rasterize
from slideframe_render_gs.film import draw
from slideframe_render_gs.renderer import SplatRenderer

# Rotating the scene and turning the camera differ by float32 positions and 8-bit levels only.
TURNED_PSNR_DB = 50.0
COUNT = 400
CAMERA = Camera(width=120, height=90, focal_x=110.0, focal_y=110.0, principal_x=60.0, principal_y=45.0)
POSE = np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0], [0, -9.0, 0]])


def cloud(coefficients: int = 16) -> SplatCloud:
    random = np.random.default_rng(0)
    rotations = random.normal(size=(COUNT, 4))
    return SplatCloud(
        centers=random.uniform(-2, 2, (COUNT, 3)).astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=random.uniform(0.05, 0.2, (COUNT, 3)).astype(np.float32),
        opacities=random.uniform(0.3, 0.95, COUNT).astype(np.float32),
        harmonics=(0.4 * random.normal(size=(COUNT, coefficients, 3))).astype(np.float32),
    )


def filling(splats: SplatCloud, carriers: np.ndarray) -> Filling:
    return Filling(
        bounds=np.array([[-2.0, -2, -2], [2, 2, 2]]),
        particle_positions=splats.centers,
        particle_volumes=np.ones(COUNT, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.empty(0, np.int32),
        surface_particles=carriers.astype(np.int32),
        surface_vertices=np.zeros((3, 3), np.float32),
        surface_triangles=np.zeros((1, 3), np.int32),
        surface_support=np.zeros(3, np.uint8),
    )


def frame(positions: np.ndarray, F: np.ndarray, time: float = 0.0) -> ParticleFrame:
    positions = positions.astype(np.float32)
    gradients = np.broadcast_to(F, (COUNT, 3, 3)).astype(np.float32)
    return ParticleFrame(time=time, positions=positions, velocities=0 * positions, deformation_gradients=gradients)


def test_a_rotated_scene_is_the_scene_from_the_turned_camera():
    splats = cloud()
    R, shift = rotation_matrices(np.array([[0.9, 0.2, -0.3, 0.25]]))[0], np.array([0.3, -0.2, 0.1])
    moved = Coupling(splats, filling(splats, np.arange(COUNT))).at(frame(splats.centers @ R.T + shift, R))
    seen = draw(moved, CAMERA, POSE, (0.1, 0.2, 0.3)).astype(float)
    turned = np.column_stack([R.T @ POSE[:, :3], R.T @ (POSE[:, 3] - shift)])
    still = Coupling(splats, filling(splats, np.full(COUNT, -1))).at(frame(splats.centers, np.eye(3)))
    expected = draw(still, CAMERA, turned, (0.1, 0.2, 0.3)).astype(float)
    assert 10 * np.log10(255**2 / max(np.mean((seen - expected) ** 2), 1e-9)) >= TURNED_PSNR_DB
    assert np.ptp(expected) > 100


def test_a_still_scene_is_what_the_rasteriser_draws():
    splats = cloud()
    still = Coupling(splats, filling(splats, np.full(COUNT, -1))).at(frame(splats.centers, np.eye(3)))
    centers = torch.tensor(splats.centers)
    colours = evaluate_harmonics(
        torch.tensor(splats.harmonics), centers - torch.tensor(POSE[:, 3], dtype=torch.float32)
    )
    shape = [torch.tensor(a) for a in (splats.rotations, splats.scales, splats.opacities)]
    raster = rasterize(centers, *shape, colours, camera=CAMERA, world_from_camera=POSE)
    expected = raster.colour.clamp(0, 1).mul(255).round().numpy()
    np.testing.assert_allclose(draw(still, CAMERA, POSE, (0, 0, 0)), expected, atol=1)


def view(turn: float = 0.0) -> View:
    return View(width=64, height=48, turn=turn)


def context(folder: Path) -> Context:
    return Context(device=Device(), scratch=folder)


def test_pictures_follow_the_motion_one_at_a_time(tmp_path):
    splats = cloud(4)
    read: list[float] = []

    def motion():
        for index in range(4):
            read.append(index)
            yield frame(splats.centers - [0, 0, 0.3 * index], np.eye(3), 0.04 * index)

    surroundings = context(tmp_path)
    film = SplatRenderer().render(
        hillside_survey(), splats, filling(splats, np.arange(COUNT)), motion(), view(), surroundings
    )
    first = next(film)
    assert read == [0]
    rest = list(film)
    assert [picture.time for picture in rest] == pytest.approx([0.04, 0.08, 0.12])
    assert first.pixels.shape == (48, 64, 3)
    assert not np.array_equal(first.pixels, rest[-1].pixels)
    assert surroundings.figures["splats"] == COUNT
    assert surroundings.figures["frames_per_second"] > 0


def test_the_camera_turns_over_a_film_of_known_length(tmp_path):
    splats = cloud(1)
    still = [frame(splats.centers, np.eye(3), 0.04 * index) for index in range(3)]
    carriers = filling(splats, np.full(COUNT, -1))
    turning = list(SplatRenderer().render(hillside_survey(), splats, carriers, still, view(turn=90), context(tmp_path)))
    standing = list(SplatRenderer().render(hillside_survey(), splats, carriers, still, view(), context(tmp_path)))
    assert turning[0] == standing[0] == standing[2].model_copy(update={"time": 0.0})
    assert not np.array_equal(turning[0].pixels, turning[1].pixels)
    surroundings = context(tmp_path)
    list(SplatRenderer().render(hillside_survey(), splats, carriers, iter(still), view(turn=90), surroundings))
    assert "does not turn" in surroundings.warnings[0]
