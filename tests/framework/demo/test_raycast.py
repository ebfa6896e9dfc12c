"""What a picture shows is where the camera says it is."""

import numpy as np
import pytest

from slideframe.demo.appearance import Appearance
from slideframe.demo.flight import FLIGHT_MEAN, fly, rotation_from_gimbal
from slideframe.demo.grid import GroundGrid
from slideframe.demo.lens import full_size_camera, pixel_rays, project, reduced_camera
from slideframe.demo.raycast import make_ground, photograph
from slideframe.demo.scene import build_scene

# A disc of some 100 pixels, sensor noise of 2 in 200 grey levels: its centre of light is good to 0.02 px.
MARK_TOLERANCE_PX = 0.1
LENS_TOLERANCE_PX = 1e-3  # rays are float32


@pytest.fixture(scope="module")
def scene():
    return build_scene(160)


def test_lens_is_inverted_at_every_pixel():
    camera = reduced_camera(132)
    rays = pixel_rays(camera).astype(np.float64)
    pixels = project(rays.reshape(-1, 3), np.eye(3, 4), camera).reshape(camera.height, camera.width, 2)
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=-1), atol=LENS_TOLERANCE_PX)


def test_distortion_is_worth_undoing():
    camera = full_size_camera()
    pinhole = camera.model_copy(update={"distortion": (0.0,) * 5})
    corner = np.array([[-0.7, -0.53, 1.0]])
    shift = project(corner, np.eye(3, 4), camera) - project(corner, np.eye(3, 4), pinhole)
    assert np.linalg.norm(shift) > 100


@pytest.mark.parametrize("gimbal", [(0, -90, 0), (37, -48, 4), (-120, -60, -3)])
def test_a_mark_on_the_ground_shows_where_the_camera_projects_it(gimbal):
    grid = GroundGrid(0.25, 400)
    x, y = np.meshgrid(grid.axis, grid.axis)
    slope = 0.3 * x + 0.1 * y
    fine = GroundGrid(0.05, 2000)
    rotation = rotation_from_gimbal(*gimbal)
    pose = np.column_stack([rotation, -30 * rotation[:, 2]])
    pose[2, 3] += 2.0
    camera = reduced_camera(400)
    mark = (pose[:, 3] + rotation @ [6.0, -5.0, 20.0])[:2]
    u, v = np.meshgrid(fine.axis, fine.axis)
    painted = np.where(np.hypot(u - mark[0], v - mark[1]) < 0.6, 220, 20).astype(np.uint8)
    appearance = Appearance((fine,), (np.stack([painted] * 3),))
    ground = make_ground(grid, slope.astype(np.float32))
    picture = photograph(ground, appearance, camera, pixel_rays(camera), pose, seed=1).astype(float)[..., 1]
    light = np.where(picture > 60, picture - 20, 0)
    rows, columns = np.indices(picture.shape) + 0.5
    seen = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)[:, None]
    radius = 0.6 * np.sqrt(np.linspace(0.02, 1, 40))
    ring = np.stack([mark[0] + radius * np.cos(angle), mark[1] + radius * np.sin(angle)], axis=-1).reshape(-1, 2)
    points = np.column_stack([ring, ring @ [0.3, 0.1]])
    # a patch of a plane fills the picture with the inverse cube of its depth
    weight = ((points - pose[:, 3]) @ pose[:, 2]) ** -3.0
    expected = np.average(project(points, pose, camera), axis=0, weights=weight)
    np.testing.assert_allclose(seen, expected, atol=MARK_TOLERANCE_PX)


def test_depths_end_on_the_terrain_and_before_nothing_else(scene):
    camera = reduced_camera(160)
    for pose in fly(5).world_from_camera:
        depths = scene.depths(camera, pose).astype(np.float64)
        local = pixel_rays(camera) * depths[..., None]
        points = (local.reshape(-1, 3) @ pose[:, :3].T + pose[:, 3] + FLIGHT_MEAN).astype(np.float32)
        gap = points[:, 2] - scene.terrain.grid.lookup(scene.terrain.heights, points[:, 0], points[:, 1])
        # rays that graze the edge of a shrub may stop between it and what lies behind
        assert np.mean(np.abs(gap) < 0.01) > 0.995
        # the way there is free: at 99 % of it and before, the ray is over the ground
        way = np.linspace(0.3, 0.99, 60)[:, None, None]
        start = pose[:, 3] + FLIGHT_MEAN
        middle = (start + way * (points[::37] - start)).astype(np.float32)
        height = scene.terrain.grid.lookup(scene.terrain.heights, middle[..., 0], middle[..., 1])
        assert np.mean((middle[..., 2] > height - 0.05).all(axis=0)) > 0.99


def test_detail_is_the_same_ground_at_every_resolution(scene):
    fine = build_scene(480)
    at = np.random.default_rng(3).uniform(-60, 60, (2, 4000)).astype(np.float32)
    coarse_height = scene.terrain.grid.lookup(scene.terrain.heights, *at)
    fine_height = fine.terrain.grid.lookup(fine.terrain.heights, *at)
    assert np.median(np.abs(coarse_height - fine_height)) < 0.1
