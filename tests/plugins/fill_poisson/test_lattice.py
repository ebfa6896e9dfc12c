"""Particles of arbitrary stretches of soil, and lines through meshes with overhangs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.problem import BoxRegion
from slideframe_fill_poisson.lattice import Lattice, measure_volume, place_particles
from slideframe_fill_poisson.surface import Crossings, Surface

FLOAT32_ROUNDING = 1e-5


def lattice_of(spacing):
    return Lattice(BoxRegion(x_min=0, x_max=1, y_min=0, y_max=1, z_min=-2), spacing)


@given(
    spacing=st.floats(0.05, 0.7),
    stretches=st.lists(st.tuples(st.floats(0, 3), st.floats(0.0, 3)), min_size=1, max_size=5),
)
@settings(max_examples=200)
def test_particles_hold_the_soil_of_every_stretch(spacing, stretches):
    lattice = lattice_of(spacing)
    bottoms = np.array([-2 + bottom for bottom, _ in stretches], np.float32)
    tops = np.array([-2 + bottom + length for bottom, length in stretches], np.float32)
    for bottom, top in zip(bottoms, tops, strict=True):
        soil = Crossings(np.zeros(1, np.int32), tops=np.array([top]), bottoms=np.array([bottom]))
        positions, volumes = place_particles(soil, lattice)
        length = float(top) - float(bottom)
        if len(volumes):
            assert volumes.sum(dtype=np.float64) / lattice.cell_area == pytest.approx(length, abs=FLOAT32_ROUNDING)
            most = 2 if len(volumes) == 1 else 1.5
            assert volumes.max() <= (most * spacing + FLOAT32_ROUNDING) * lattice.cell_area
            assert bottom < positions[:, 2].min() <= positions[:, 2].max() < top
        else:
            assert length < spacing


@given(spacing=st.floats(0.04, 3.0), width=st.floats(0.5, 9.0), depth=st.floats(0.5, 9.0))
def test_columns_tile_the_plan(spacing, width, depth):
    lattice = Lattice(BoxRegion(x_min=2, x_max=2 + width, y_min=-1, y_max=-1 + depth, z_min=0), spacing)
    x, y = lattice.columns()
    assert len(x) == len(y) == np.prod(lattice.shape)
    assert lattice.cell_area * len(x) == pytest.approx(width * depth)
    assert x.min() > 2
    assert x.max() < 2 + width
    assert y.mean() == pytest.approx(-1 + depth / 2)


def surface_of(*polygons):
    """A mesh of quadrilaterals, counter-clockwise seen from the air."""
    vertices = np.concatenate([np.asarray(polygon, np.float32) for polygon in polygons])
    quads = 4 * np.arange(len(polygons))[:, None]
    triangles = np.concatenate([quads + np.array(corners) for corners in ([0, 1, 2], [0, 2, 3])]).astype(np.int32)
    return Surface(vertices, triangles, np.zeros(len(vertices), np.uint8))


def level(height, *, up, low=-1.0, high=2.0):
    corners = [[low, low, height], [high, low, height], [high, high, height], [low, high, height]]
    return corners if up else corners[::-1]


def test_soil_between_faces():
    """Ground at 0, a roof from 2 to 3 over it."""
    surface = surface_of(level(0.0, up=True), level(2.0, up=False), level(3.0, up=True))
    soil = surface.soil(np.array([0.1, 0.7, 9.0]), np.array([0.2, 0.9, 9.0]), -2.0)
    np.testing.assert_array_equal(soil.lines, [0, 0, 1, 1])
    np.testing.assert_allclose(soil.tops, [3, 0, 3, 0], atol=FLOAT32_ROUNDING)
    np.testing.assert_allclose(soil.bottoms, [2, -2, 2, -2], atol=FLOAT32_ROUNDING)
    assert measure_volume(surface, lattice_of(0.1)) == pytest.approx(3.0, rel=1e-4)
    above = np.array([[0, 0, -1], [0, 0, 1], [0, 0, 2.5], [0, 0, 4], [9, 9, 0]], np.float32)
    np.testing.assert_array_equal(surface.inside(above), [True, False, True, False, False])


def test_base_between_faces_cuts_the_soil():
    surface = surface_of(level(0.0, up=True), level(2.0, up=False), level(3.0, up=True))
    soil = surface.soil(np.array([0.1]), np.array([0.2]), 2.5)
    np.testing.assert_allclose([soil.tops, soil.bottoms], [[3.0], [2.5]], atol=FLOAT32_ROUNDING)


def test_no_line_meets_the_ground():
    soil = surface_of(level(0.0, up=True)).soil(np.array([50.0]), np.array([50.0]), -2.0)
    assert len(soil.lines) == len(soil.tops) == len(soil.bottoms) == 0


def test_an_edge_counts_once():
    """Lines through the diagonal that two triangles share."""
    surface = surface_of(level(1.0, up=True))
    along = np.linspace(-0.9, 1.9, 400)
    soil = surface.soil(along, along, 0.0)
    np.testing.assert_array_equal(soil.lines, np.arange(400))
