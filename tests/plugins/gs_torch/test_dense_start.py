"""Points between the sparse ones lie on the ground, where no point was, and have the photographs' colours."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from slideframe.products import Camera, Georeference, Photograph, Survey
from slideframe_gs_torch.dense_start import (
    ViewDepths,
    cells_with_points,
    dense_points,
    pixel_rays,
    points_in_empty_cells,
)
from slideframe_gs_torch.ground_surface import GroundSurface
from slideframe_gs_torch.views import TrainingView

CAMERA = Camera(width=64, height=48, focal_x=50.0, focal_y=50.0, principal_x=30.0, principal_y=25.0)
TILT = np.array([0.2, -0.1, 0.05])  # the ground: z = TILT . (x, y, 1)


def looking_down(x: float) -> np.ndarray:
    return np.column_stack([np.diag([1.0, -1, -1]), [x, 0.0, 10.0]])


def view(x: float = 0.0, mask: torch.Tensor | None = None) -> TrainingView:
    pixels = torch.zeros(3, 48, 64, dtype=torch.uint8)
    pixels[0, :, :32], pixels[1, :, 32:] = 255, 255
    return TrainingView("", pixels, mask, CAMERA, looking_down(x))


def ground_points(count: int, reach: float = 4.0) -> np.ndarray:
    plan = np.random.default_rng(0).uniform(-reach, reach, (count, 2))
    return np.column_stack([plan, np.column_stack([plan, np.ones(count)]) @ TILT]).astype(np.float32)


def survey(points: np.ndarray) -> Survey:
    poses = np.array([looking_down(x) for x in (0.0, 3.0)])
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(CAMERA,),
        photographs=tuple(Photograph(path=f"{k}.png", camera=0, sha256="") for k in range(2)),
        world_from_camera=poses,
        position_sigma=np.ones((2, 3)),
        sparse_points=points,
        sparse_colors=np.full((len(points), 3), 128, np.uint8),
        sparse_errors=np.ones(len(points), np.float32),
    )


@pytest.mark.parametrize("reach", [4.0, 2.0])
def test_points_lie_on_sloping_ground_also_beyond_the_sparse_ones(reach):
    points, colours = dense_points(survey(ground_points(200, reach)), [view(), view(3.0)], 1500)
    assert 700 < len(points) <= 1500
    heights = np.column_stack([points[:, :2], np.ones(len(points))]) @ TILT
    # a point is taken to be at the middle of its pixel, a fifth of a metre wide
    assert np.abs(points[:, 2] - heights).max() < 0.12
    assert np.ptp(points[:, 0]) > 12
    np.testing.assert_array_equal(points[:200], ground_points(200, reach))
    red = colours[200:, 0] > 0.5
    assert 0.2 < red.mean() < 0.8
    assert np.abs(colours[200:].sum(axis=1) - 1).max() < 1e-5


def test_beyond_a_view_s_points_the_ground_goes_on_as_the_whole_survey_knows_it():
    """A valley: the plane that fits one photograph's points best cuts through its far side."""
    plan = np.random.default_rng(0).uniform((-4, -4), (7, 4), (1500, 2))
    valley = np.column_stack([plan, 0.1 * plan[:, 0] ** 2]).astype(np.float32)
    near = valley[valley[:, 0] < 1]  # of the points, the view knows those of one side
    places = np.column_stack([np.linspace(40, 60, 20), np.full(20, 25.0)])
    rays = pixel_rays(places, CAMERA) @ looking_down(0.0)[:, :3].T
    errors = {}
    for ground in (None, GroundSurface.of(valley)):
        depths = ViewDepths.of(near, view(), ground)
        assert depths is not None
        found = looking_down(0.0)[:, 3] + depths.at(places)[:, None] * rays
        errors[ground is not None] = np.abs(found[:, 2] - 0.1 * found[:, 0] ** 2).max()
    assert errors[True] < 0.1 < 0.3 < errors[False]


def test_every_cell_of_a_view_shows_a_point_and_none_gets_a_second():
    sparse = ground_points(200)
    shown = view()
    depths = ViewDepths.of(sparse, shown, None)
    assert depths is not None
    before = cells_with_points(sparse.astype(float), shown, 4)
    added, _ = points_in_empty_cells(sparse.astype(float), shown, depths, 4)
    assert len(added) == (~before).sum() > 0
    assert cells_with_points(np.concatenate([sparse, added]), shown, 4).all()


def test_what_a_mask_leaves_out_gets_no_points():
    mask = torch.ones(48, 64, dtype=torch.bool)
    mask[:, 32:] = False
    _, colours = dense_points(survey(ground_points(200)), [view(mask=mask)], 1500)
    assert (colours[200:, 0] > 0.5).all()


def test_views_that_see_too_few_points_add_none():
    assert ViewDepths.of(ground_points(5), view(), None) is None
    line = np.column_stack([np.linspace(-3, 3, 40), np.zeros(40), np.zeros(40)]).astype(np.float32)
    assert ViewDepths.of(line, replace(view(), world_from_camera=looking_down(0.0)), None) is None
    points, _ = dense_points(survey(ground_points(5)), [view()], 1500)
    assert len(points) == 5


def test_the_sparse_points_alone_are_kept_where_no_more_are_wanted():
    points, _ = dense_points(survey(ground_points(200)), [view()], 0)
    assert len(points) == 200
