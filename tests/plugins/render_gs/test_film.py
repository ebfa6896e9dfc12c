"""Films of moving splats."""

from pathlib import Path

import numpy as np
import pytest
import torch

from slideframe.coupling import Coupling
from slideframe.device import Device
from slideframe.errors import InputError
from slideframe.problem import FlightView, OrbitView, View
from slideframe.products import Camera, Filling, ParticleFrame, SplatCloud
from slideframe.rotations import rotation_matrices
from slideframe.stages import Context
from slideframe.testing.ground_scenes import hillside_survey
from slideframe_gs_torch.harmonics import evaluate_harmonics
from slideframe_gs_torch.rasterize import rasterize
from slideframe_render_gs.drawing import draw, enlarge
from slideframe_render_gs.moving_scene import MovingScene
from slideframe_render_gs.renderer import SplatRenderer

# Rotating the scene and turning the camera differ by float32 positions and 8-bit levels only.
TURNED_PSNR_DB = 50.0
# A splat has the depth of its centre all over, and nearer ones hide the next: part of a splat's 0.12 m at 9 m.
CENTRE_DEPTH = 0.012
BACKGROUND = (0.1, 0.2, 0.3)
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


PLAIN = OrbitView(width=120, height=90, background=BACKGROUND)


def picture(scene: MovingScene, moment: ParticleFrame, pose: np.ndarray, view: View = PLAIN) -> np.ndarray:
    moved = scene.at(moment, enlarge(CAMERA, view.supersampling), pose)
    return draw(moved, CAMERA, pose, view)[0]["pixels"].astype(float)


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_a_rotated_scene_is_the_scene_from_the_turned_camera(coefficients):
    splats = cloud(coefficients)
    R, shift = rotation_matrices(np.array([[0.9, 0.2, -0.3, 0.25]]))[0], np.array([0.3, -0.2, 0.1])
    moving = MovingScene(Coupling(splats, filling(splats, np.arange(COUNT))))
    seen = picture(moving, frame(splats.centers @ R.T + shift, R), POSE)
    turned = np.column_stack([R.T @ POSE[:, :3], R.T @ (POSE[:, 3] - shift)])
    still = MovingScene(Coupling(splats, filling(splats, np.full(COUNT, -1))))
    expected = picture(still, frame(splats.centers, np.eye(3)), turned)
    assert 10 * np.log10(255**2 / max(np.mean((seen - expected) ** 2), 1e-9)) >= TURNED_PSNR_DB
    assert np.ptp(expected) > 100
    # and the turn matters: without it the pictures are unlike
    assert np.abs(seen - picture(still, frame(splats.centers, np.eye(3)), POSE)).mean() > 5


def test_a_still_scene_is_what_the_rasteriser_draws():
    splats = cloud()
    still = MovingScene(Coupling(splats, filling(splats, np.full(COUNT, -1))))
    centers = torch.tensor(splats.centers)
    colours = evaluate_harmonics(
        torch.tensor(splats.harmonics), centers - torch.tensor(POSE[:, 3], dtype=torch.float32)
    )
    shape = [torch.tensor(a) for a in (splats.rotations, splats.scales, splats.opacities)]
    raster = rasterize(centers, *shape, colours, camera=CAMERA, world_from_camera=POSE, background=BACKGROUND)
    expected = raster.colour.clamp(0, 1).mul(255).round().numpy()
    np.testing.assert_allclose(picture(still, frame(splats.centers, np.eye(3)), POSE), expected, atol=1)


def test_supersampling_is_the_mean_of_a_finer_picture():
    splats = cloud(4)
    still = MovingScene(Coupling(splats, filling(splats, np.full(COUNT, -1))))
    moment = frame(splats.centers, np.eye(3))
    fine_view = OrbitView(width=360, height=270, background=BACKGROUND)
    fine = draw(still.at(moment, enlarge(CAMERA, 3), POSE), enlarge(CAMERA, 3), POSE, fine_view)[0]["pixels"].astype(
        float
    )
    averaged = picture(still, moment, POSE, PLAIN.model_copy(update={"supersampling": 3}))
    np.testing.assert_allclose(averaged, fine.reshape(90, 3, 120, 3, 3).mean(axis=(1, 3)), atol=1)


def test_maps_of_a_plane_are_its_depth_and_normal():
    """A wall of splats in the plane y = 0.5 x, seen from 9 m south of the origin."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(-12, 12, 121), np.linspace(-8, 8, 81)))
    along, normal = np.array([1, 0.5, 0]) / np.hypot(1, 0.5), np.array([0.5, -1, 0]) / np.hypot(1, 0.5)
    count = len(u)
    turn = np.float32([np.cos(np.arctan(0.5) / 2), 0, 0, np.sin(np.arctan(0.5) / 2)])
    wall = SplatCloud(
        centers=(u[:, None] * along + v[:, None] * [0, 0, 1]).astype(np.float32),
        rotations=np.tile(turn, (count, 1)),
        scales=np.tile(np.float32([0.12, 0.001, 0.12]), (count, 1)),
        opacities=np.full(count, 0.99, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )
    scene = MovingScene(Coupling(wall, filling(cloud(), np.full(count, -1))))
    view = PLAIN.model_copy(update={"maps": ("depth", "alpha", "normal")})
    moved = scene.at(frame(cloud().centers, np.eye(3)), CAMERA, POSE)
    maps, _ = draw(moved, CAMERA, POSE, view)
    slope = (np.arange(120) + 0.5 - 60) / 110
    expected = 9 / (1 - 0.5 * slope)  # y = 0.5 x meets x = slope (y + 9)
    inner = np.s_[10:-10, 10:-10]
    np.testing.assert_allclose(maps["depth"][inner], np.tile(expected, (90, 1))[inner], rtol=CENTRE_DEPTH)
    assert maps["alpha"][inner].min() > 0.95
    assert (maps["normal"][inner] @ normal).mean() > 0.99
    assert set(draw(moved, CAMERA, POSE, PLAIN)[0]) == {"pixels"}


def view(turn: float = 0.0) -> View:
    return OrbitView(width=64, height=48, turn=turn)


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
    assert any("stands still" in warning for warning in surroundings.warnings)


def test_a_camera_that_sees_nothing_is_an_error_that_says_where_the_scene_is(tmp_path):
    splats = cloud(1)
    away = FlightView(positions=((0, 0, 50),), targets=((0, 0, 90),))
    still = [frame(splats.centers, np.eye(3))]
    film = SplatRenderer().render(
        hillside_survey(), splats, filling(splats, np.arange(COUNT)), still, away, context(tmp_path)
    )
    with pytest.raises(InputError, match=r"sees nothing(.|\n)*x -1\.9 to 2\.0"):
        next(film)


def test_a_view_far_beside_all_photographs_is_told(tmp_path):
    """The hillside's four photographs look down from above."""
    splats = cloud(1)
    still, carriers = [frame(splats.centers, np.eye(3))], filling(splats, np.arange(COUNT))

    def warnings(elevation: float) -> list[str]:
        surroundings = context(tmp_path)
        seen = OrbitView(width=64, height=48, elevation=elevation)
        list(SplatRenderer().render(hillside_survey(), splats, carriers, still, seen, surroundings))
        return surroundings.warnings

    assert warnings(88) == []
    assert "beside the nearest photograph" in warnings(10)[0]


@pytest.mark.parametrize("listed", [True, False])
def test_a_film_that_broke_off_goes_on_with_the_same_bits(tmp_path, listed):
    splats = cloud(4)
    ground = filling(splats, np.arange(COUNT))
    random = np.random.default_rng(3)
    frames = [
        frame(splats.centers - [0, 0, 0.2 * i], np.eye(3) + 0.05 * i * random.normal(size=(3, 3)), 0.04 * i)
        for i in range(5)
    ]

    def film(surroundings: Context):
        motion = frames if listed else iter(frames)
        return list(SplatRenderer().render(hillside_survey(), splats, ground, motion, view(turn=40), surroundings))

    whole = film(context(tmp_path))
    later = Context(device=Device(), scratch=tmp_path, stored=3)
    rest = film(later)
    assert later.first_item == 3
    assert rest == whole[3:]
