"""A site in parts: what each keeps and sees, and that the parts together are the whole."""

import numpy as np
import pytest

from slideframe.products import Camera, Georeference, Photograph, SplatCloud, Survey
from slideframe_gs_torch.blocks import blocks_of, merge, survey_of

CAMERA = Camera(width=60, height=60, focal_x=60.0, focal_y=60.0, principal_x=30.0, principal_y=30.0)


def long_site(count: int = 2000) -> Survey:
    """Eleven photographs over a strip of 100 x 10 m, each of which sees 10 m."""
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(0, 100, count), random.uniform(0, 10, count), np.zeros(count)])
    poses = [np.column_stack([np.diag([1.0, -1, -1]), [10.0 * k, 5.0, 10.0]]) for k in range(11)]
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(CAMERA,),
        photographs=tuple(Photograph(path=f"{k}.png", camera=0, sha256="") for k in range(11)),
        world_from_camera=np.array(poses),
        position_sigma=np.ones((11, 3)),
        sparse_points=points.astype(np.float32),
        sparse_colors=np.full((count, 3), 128, np.uint8),
        sparse_errors=np.ones(count, np.float32),
    )


def cloud(points: np.ndarray) -> SplatCloud:
    count = len(points)
    return SplatCloud(
        centers=points.astype(np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.1, np.float32),
        opacities=np.linspace(0.1, 0.9, count, dtype=np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_blocks_share_the_plan_out_with_nothing_left_and_nothing_twice(count):
    survey = long_site()
    blocks = blocks_of(survey, count)
    assert len(blocks) == count
    anywhere = np.random.default_rng(1).uniform(-500, 500, (400, 3))
    places = np.concatenate([anywhere, survey.sparse_points])
    assert (sum(block.contains(places).astype(int) for block in blocks) == 1).all()
    shares = [block.contains(survey.sparse_points).mean() for block in blocks]
    assert shares == pytest.approx([1 / count] * count, abs=0.01)


def test_a_block_has_the_photographs_that_see_it_and_their_points():
    survey = long_site()
    first, second = blocks_of(survey, 2)
    assert first.photographs == (0, 1, 2, 3, 4, 5)
    assert second.photographs == (5, 6, 7, 8, 9, 10)
    own = survey_of(survey, first)
    assert own.sparse_points[:, 0].max() == pytest.approx(55, abs=0.5)
    assert len(own.sparse_colors) == len(own.sparse_errors) == len(own.sparse_points)


def test_what_blocks_keep_is_the_whole_once_merged():
    survey = long_site()
    splats = cloud(np.random.default_rng(2).uniform(-20, 120, (300, 3)))
    blocks = blocks_of(survey, 3)
    merged = merge([block.keep(splats) for block in blocks])
    assert sorted(merged.opacities) == sorted(splats.opacities)


def test_a_site_without_points_is_one_block():
    survey = long_site(3)
    (block,) = blocks_of(survey, 2)
    assert block.is_whole
    assert len(block.photographs) == 11
