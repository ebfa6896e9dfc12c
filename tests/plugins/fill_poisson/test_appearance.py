"""Colours of soil that nobody saw."""

import numpy as np

from slideframe.products import SplatCloud
from slideframe_fill_poisson.appearance import HARMONIC_0, SoilColors

GRASS, SHADOW, PAINT = (0.2, 0.6, 0.1), (0.02, 0.02, 0.02), (1.0, 1.0, 1.0)
SOIL = np.array([0.5, 0.4, 0.3])
VARIETY = 0.08


def ground(random):
    """Half grass; of the bare half some in shadow, some painted, most brown in shades that differ by VARIETY."""
    vertices = random.uniform(-20, 20, (4000, 3)).astype(np.float32) * [1, 1, 0]
    colors = SOIL + random.uniform(-VARIETY, VARIETY, (4000, 1))
    colors[:2000] = GRASS
    colors[2000:2100], colors[2100:2200] = SHADOW, PAINT
    return vertices.astype(np.float32), colors.astype(np.float32)


def soil_at(points, *, palette=(), depth):
    vertices, colors = ground(np.random.default_rng(1))
    soil = SoilColors(SplatCloud.empty(), vertices, colors, 32, palette)
    foot = points + np.float32([0, 0, depth])
    base = soil.at(points, foot, np.zeros(len(points), np.int32), 0.5)
    assert base.shape == (len(points), 1, 3)
    return 0.5 + HARMONIC_0 * base[:, 0]


def points(count=20_000):
    return np.random.default_rng(2).uniform(-20, 20, (count, 3)).astype(np.float32)


def test_deep_soil_varies_as_bare_ground_does():
    colors = soil_at(points(), depth=30.0)
    assert np.abs(np.median(colors, axis=0) - SOIL).max() < 0.02
    spread = colors.std(axis=0)
    assert (0.5 * VARIETY / np.sqrt(3) < spread).all(), "as varied as photographs show it"
    assert (spread < 1.5 * VARIETY / np.sqrt(3)).all()


def test_neither_plants_nor_shadows_nor_paint_are_soil():
    colors = soil_at(points(), depth=30.0)
    assert np.abs(colors - SOIL).max() < 1.2 * VARIETY, "two lumps' deviations, weighted 0.5 and 0.4, at most"


def test_just_below_the_surface_soil_has_the_surfaces_colour():
    grass = soil_at(points(), depth=0.001)
    assert np.abs(np.median(grass, axis=0) - GRASS).max() < 0.02


def test_neighbours_in_a_lump_are_alike_and_the_same_every_time():
    near = np.repeat(np.float32([[3.1, 4.1, -2.0]]), 2, axis=0) + np.float32([[0, 0, 0], [0.2, 0.2, 0.2]])
    one, other = soil_at(near, depth=30.0)
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(soil_at(points(100), depth=30.0), soil_at(points(100), depth=30.0))


def test_a_palette_is_all_there_is():
    palette = ((0.1, 0.2, 0.3), (0.9, 0.8, 0.7))
    colors = soil_at(points(), palette=palette, depth=1.0)
    is_first = np.isclose(colors, palette[0], atol=1e-6).all(axis=1)
    is_second = np.isclose(colors, palette[1], atol=1e-6).all(axis=1)
    assert (is_first | is_second).all()
    assert 0.4 < is_first.mean() < 0.6
