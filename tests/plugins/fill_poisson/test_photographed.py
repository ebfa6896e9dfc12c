"""Colours of the ground from photographs."""

import numpy as np
import pytest
from PIL import Image

from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_fill_poisson.photographed import photographed_colors

RED, BLUE, BROWN = (200, 30, 20), (20, 40, 180), (120, 90, 60)
# 8 bits, and JPEG
LEVELS = 4 / 255
OVERHEAD = 8


@pytest.fixture
def taken(survey, tmp_path):
    """A survey of which only some photographs are still there."""

    def take(pictures):
        photographs = [
            photograph.model_copy(update={"path": tmp_path / photograph.path.name}) for photograph in survey.photographs
        ]
        for index, pixels in pictures.items():
            Image.fromarray(pixels).save(photographs[index].path, quality=95)
        return survey.model_copy(update={"photographs": tuple(photographs)})

    return take


def plain(color):
    return np.tile(np.uint8(color), (600, 800, 1))


def test_each_point_has_the_colour_where_the_photograph_shows_it(taken):
    halves = plain(RED)
    halves[:, :400] = BLUE  # the overhead camera has east on its left
    points = np.float32([[-5, 0, 0], [5, 1, 0], [-2, 3, 1], [400, 0, 0]])
    colors = photographed_colors(points, taken({OVERHEAD: halves}), 0.3, 0.5)
    np.testing.assert_allclose(colors[:3], np.array([RED, BLUE, RED]) / 255, atol=LEVELS)
    assert np.isnan(colors[3]).all()


def test_the_nearest_photograph_that_sees_a_point_tells(taken):
    # the first camera of the ring stands east of the origin, 39 m away; the overhead one 45 m
    both = taken({0: plain(RED), OVERHEAD: plain(BLUE)})
    np.testing.assert_allclose(
        photographed_colors(np.float32([[0, 0, 0]]), both, 0.3, 0.5)[0], np.array(RED) / 255, atol=LEVELS
    )
    # a wall between the origin and the eastern camera
    wall = np.stack(np.meshgrid([2.0], np.arange(-4, 4, 0.3), np.arange(0, 6, 0.3)), axis=-1).reshape(-1, 3)
    points = np.concatenate([[[0, 0, 0]], wall]).astype(np.float32)
    np.testing.assert_allclose(photographed_colors(points, both, 0.3, 0.5)[0], np.array(BLUE) / 255, atol=LEVELS)


def test_soil_has_the_photographs_colour(taken, make_splats, scatter, box, context):
    seen = taken(dict.fromkeys(range(9), plain(BROWN)))
    filling = PoissonFiller().fill(seen, make_splats(scatter(lambda x, y: 3 + 0.6 * y)), box(), context)
    colors = 0.5 + 0.28209479 * filling.interior.harmonics[:, 0]
    assert np.abs(colors - np.array(BROWN) / 255).max() < 2 * LEVELS
    assert context.figures["photographed_share"] > 0.9
