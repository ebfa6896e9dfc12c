"""The ground through sparse points and beyond them, and where rays meet it."""

import numpy as np
import pytest

from slideframe_gs_torch.ground_surface import GroundSurface, without_outliers

SLOPE = np.array([0.3, -0.2])


def hills(plan: np.ndarray) -> np.ndarray:
    return plan @ SLOPE + 4 * np.sin(plan[:, 0] / 30) * np.cos(plan[:, 1] / 25)


def points(count: int = 3000, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    plan = random.uniform(-60, 60, (count, 2))
    return np.column_stack([plan, hills(plan) + 0.02 * random.normal(size=count)]).astype(np.float32)


def surface(found: np.ndarray) -> GroundSurface:
    ground = GroundSurface.of(found)
    assert ground is not None
    return ground


def test_between_points_the_surface_is_the_ground_and_beyond_them_it_goes_on():
    ground = surface(points())
    inside = np.random.default_rng(1).uniform(-55, 55, (500, 2))
    assert np.abs(ground.heights(inside) - hills(inside)).max() < 0.1
    beyond = np.column_stack([np.full(50, 68.0), np.linspace(-50, 50, 50)])
    nearest = np.column_stack([np.full(50, 60.0), beyond[:, 1]])
    # better than to go on level from the last point
    assert np.abs(ground.heights(beyond) - hills(beyond)).mean() < 0.5 * np.abs(hills(nearest) - hills(beyond)).mean()


@pytest.mark.parametrize("scale", [1e-2, 1e3])
def test_the_surface_of_a_site_does_not_depend_on_its_size(scale):
    places = np.random.default_rng(2).uniform(-70, 70, (200, 2))
    found = surface((scale * points()).astype(np.float32)).heights(scale * places) / scale
    assert np.abs(found - surface(points()).heights(places)).max() < 1e-3


def test_what_lies_far_from_its_neighbours_does_not_bend_the_ground():
    wrong = points()
    wrong[::100, 2] -= 150
    assert len(without_outliers(wrong.astype(float))) == len(wrong) * 99 // 100
    inside = np.random.default_rng(1).uniform(-55, 55, (500, 2))
    assert np.abs(surface(wrong).heights(inside) - hills(inside)).max() < 0.2


def test_rays_end_on_the_ground():
    ground = surface(points())
    viewpoint = np.array([0.0, 0.0, 70.0])
    targets = np.random.default_rng(3).uniform(-50, 50, (300, 2))
    rays = np.column_stack([targets, hills(targets)]) - viewpoint
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance = np.linalg.norm(np.column_stack([targets, hills(targets)]) - viewpoint, axis=1)
    reach = ground.met_by(viewpoint, rays, distance / 1.5, distance * 1.5)
    assert np.abs(reach - distance).max() < 0.3
    bounded = ground.met_by(viewpoint, rays, distance / 1.5, distance / 1.2)
    np.testing.assert_allclose(bounded, distance / 1.2)


def test_rays_that_do_not_fall_meet_nothing():
    rays = np.array([[1.0, 0, 0], [0, 1, 0.3], [1, 0, -0.01]])
    assert np.isnan(surface(points()).met_by(np.array([0.0, 0, 70]), rays, np.ones(3), np.full(3, 1e3))).all()


def test_too_few_points_or_points_in_one_line_give_no_surface():
    assert GroundSurface.of(points(10)) is None
    line = np.column_stack([np.linspace(0, 50, 200), np.zeros(200), np.zeros(200)]).astype(np.float32)
    assert GroundSurface.of(line) is None
