"""Where photographs show the sky, and that no splats stand before it."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from slideframe.device import Device
from slideframe.products import Camera, Georeference, Photograph, Survey
from slideframe.stages import Context
from slideframe_gs_torch.evaluation import draw_view
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_gs_torch.shelf import Shelf, ShelvedViews
from slideframe_gs_torch.sky import HIGHEST_BUT, MARGIN, sky_pixels
from slideframe_gs_torch.training import mean_colour
from slideframe_gs_torch.views import TrainingView, load_views

CAMERA = Camera(width=96, height=72, focal_x=60.0, focal_y=60.0, principal_x=48.0, principal_y=36.0)
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def looking_north(x: float = 0.0, up: float = 0.0, height: float = 10.0) -> np.ndarray:
    """A camera over (x, 0), whose view axis points `up` degrees over the horizon."""
    right, forward = np.array([1.0, 0, 0]), np.array([0, np.cos(np.radians(up)), np.sin(np.radians(up))])
    return np.column_stack([right, np.cross(forward, right), forward, [x, 0, height]])


def plain(count: int = 4000) -> np.ndarray:
    random = np.random.default_rng(0)
    return np.column_stack([random.uniform(-60, 60, (count, 2)), np.zeros(count)]).astype(np.float32)


def hill() -> np.ndarray:
    """Points up to 25 m above a camera 10 m up, 40 m to the north-east of it."""
    random = np.random.default_rng(1)
    return np.column_stack([random.uniform(5, 60, 3000), np.full(3000, 40), random.uniform(0, 35, 3000)]).astype(
        np.float32
    )


def test_over_a_plain_the_sky_begins_a_margin_over_the_horizon():
    sky = sky_pixels(plain(), CAMERA, looking_north())
    rows = (CAMERA.principal_y - np.arange(72) - 0.5) / CAMERA.focal_y
    assert np.array_equal(sky[:, 48], np.degrees(np.arctan(rows)) > MARGIN)
    assert not sky[36:].any()


@pytest.mark.parametrize("up", [-90, -60, -32])
def test_a_photograph_that_looks_down_has_none(up):
    assert sky_pixels(plain(), CAMERA, looking_north(up=up)) is None


def test_a_hill_above_the_camera_is_no_sky():
    sky = sky_pixels(np.concatenate([plain(), hill()]), CAMERA, looking_north())
    slope = 25 / 40  # of the hill's top, straight behind the image plane
    top = int(CAMERA.principal_y - slope * CAMERA.focal_y)
    assert not sky[top:, 60:].any()
    assert not sky[top + 12 : 36, 60:].any()
    assert sky[top + 12 : 30, :40].all()


def test_points_in_the_air_hide_no_sky():
    air = np.repeat(np.float32([[0, 20, 25]]), HIGHEST_BUT, axis=0)
    stray = sky_pixels(np.concatenate([plain(), air]), CAMERA, looking_north())
    assert np.array_equal(stray, sky_pixels(plain(), CAMERA, looking_north()))
    tower = sky_pixels(np.concatenate([plain(), air, air]), CAMERA, looking_north())
    assert tower.sum() < stray.sum()


def test_without_points_nothing_is_taken_for_sky():
    assert sky_pixels(plain(99), CAMERA, looking_north(up=40)) is None


def view_with_sky() -> TrainingView:
    pixels = torch.zeros(3, 320, 320, dtype=torch.uint8)
    pixels[:, :101] = 200
    sky, mask = torch.zeros(320, 320, dtype=torch.bool), torch.ones(320, 320, dtype=torch.bool)
    sky[:101] = True
    mask[:101], mask[300:] = False, False
    camera = Camera(width=320, height=320, focal_x=300, focal_y=300, principal_x=160, principal_y=160)
    return TrainingView("0", pixels, mask, camera, looking_north(), sky=sky)


@pytest.mark.parametrize("room", [0, 10_000_000])
def test_sky_and_mask_come_back_from_the_shelf(tmp_path, room):
    shelved = ShelvedViews([view_with_sky()], Shelf(tmp_path, room))
    half = shelved.reduced(0, 2)
    # the pair of rows 100 and 101 is neither all sky nor all ground
    assert half.sky[:50].all()
    assert not half.sky[50:].any()
    assert half.mask[51:150].all()
    assert not half.mask[:51].any()
    assert not half.mask[150:].any()
    assert torch.equal(shelved[0].sky, view_with_sky().sky)
    assert torch.equal(shelved[0].mask, view_with_sky().mask)


def test_the_sky_is_no_part_of_the_mean_colour():
    assert mean_colour([view_with_sky()]) == BLACK


def flight(folder: Path) -> Survey:
    """Photographs over a chequered plain, half of them sky in stripes that no place in the world explains."""
    poses = [looking_north(x, up=-8, height=6) for x in np.linspace(-8, 8, 9)]
    random = np.random.default_rng(3)
    slopes = np.stack(np.meshgrid((np.arange(96) + 0.5 - 48) / 60, (np.arange(72) + 0.5 - 36) / 60), axis=-1)
    for index, pose in enumerate(poses):
        rays = np.concatenate([slopes, np.ones((72, 96, 1))], axis=2) @ pose[:, :3].T
        down = np.where(rays[..., 2:] < -1e-3, pose[2, 3] / -rays[..., 2:], 0)
        x, y = np.moveaxis(pose[:2, 3] + down * rays[..., :2], -1, 0)
        chequered = np.where((np.floor(x / 3) + np.floor(y / 6)) % 2 == 0, 150, 60)[..., None] * [1.0, 0.8, 0.5]
        sky = 190 + 50 * np.sin(slopes[..., :1] * 9 + slopes[..., 1:] * 7 + random.uniform(0, 7)) * [0.5, 0.7, 1.0]
        picture = np.where(down > 0, chequered, sky)
        Image.fromarray(picture.clip(0, 255).astype(np.uint8)).save(folder / f"{index}.png")
    points = plain()[:, [1, 0, 2]] * [0.6, 1, 1] + [0, 60, 0]
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(CAMERA,),
        photographs=tuple(Photograph(path=folder / f"{index}.png", camera=0, sha256="") for index in range(9)),
        world_from_camera=np.array(poses),
        position_sigma=np.full((9, 3), 0.02),
        sparse_points=points.astype(np.float32),
        sparse_colors=np.full((len(points), 3), 100, np.uint8),
        sparse_errors=np.ones(len(points), np.float32),
    )


@pytest.mark.parametrize(("sky", "covered"), [("clear", False), ("keep", True)])
def test_no_splats_stand_before_the_sky(tmp_path, sky, covered):
    survey, context = flight(tmp_path), Context(device=Device(), scratch=tmp_path)
    options = TorchSplats(iterations=200, splat_budget=8000, image_width=96, hold_out_every=4, sky=sky, settle_gain=0)
    splats = options.reconstruct(survey, context)
    (view,) = load_views(survey, [4], 96, context)
    stopped = 1 - (draw_view(splats, view, WHITE) - draw_view(splats, view, BLACK)).mean(dim=0)
    assert (stopped[view.sky].mean() > 0.5) == covered
    assert stopped[view.mask].mean() > 0.8
    if not covered:
        assert stopped[view.sky].mean() < 0.03
