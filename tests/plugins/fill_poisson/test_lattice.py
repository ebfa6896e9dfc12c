"""Particles of arbitrary stretches of soil."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe_fill_poisson.lattice import Lattice, place_particles
from slideframe_fill_poisson.rays import Crossings

FLOAT32_ROUNDING = 1e-5


def lattice_of(spacing):
    return Lattice(np.array([[0, 0, -2], [1, 1, 4.0]]), spacing)


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
    lattice = Lattice(np.array([[2, -1, 0], [2 + width, -1 + depth, 1.0]]), spacing)
    x, y = lattice.columns()
    assert len(x) == len(y) == np.prod(lattice.shape)
    assert lattice.cell_area * len(x) == pytest.approx(width * depth)
    assert x.min() > 2
    assert x.max() < 2 + width
    assert y.mean() == pytest.approx(-1 + depth / 2)
