"""Bodies closed, cut and taken apart."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe_fill_poisson.solids import (
    GROUND,
    PLAN,
    SKIRT,
    SLIP_SURFACE,
    close_sheet,
    closed_solid,
    height_field_sheet,
    rim_edges,
    upright_prism,
)

ROUNDING = 1e-7  # manifold3d keeps outlines to 1e-8 m


def rectangle(west, south, east, north):
    return np.array([[west, south], [east, south], [east, north], [west, north]], float)


def ground(height, side=10.0, cells=40):
    """The body under z = height(x, y), down to -20."""
    axis = np.linspace(-side, side, cells + 1)
    vertices, triangles = height_field_sheet(axis, axis, height(*np.meshgrid(axis, axis, indexing="ij")))
    return close_sheet(vertices, triangles[:, ::-1], -20.0, GROUND)


@given(
    slope=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    corners=st.tuples(st.floats(-9, -1), st.floats(-9, -1), st.floats(1, 9), st.floats(1, 9)),
    base=st.floats(-15, -12),
)
@settings(max_examples=30)
def test_wedge_is_cut_exactly(slope, corners, base):
    soil = ground(lambda x, y: slope[0] * x + slope[1] * y)
    room = upright_prism([rectangle(*corners)], base, 50.0, PLAN)
    west, south, east, north = corners
    height = slope[0] * (west + east) / 2 + slope[1] * (south + north) / 2 - base
    expected = (east - west) * (north - south) * height
    mass, rest = soil.common(room), soil.without(room)
    # a corner of a steep slope can lie below the base, which the mean height doesn't know
    lowest = min(slope[0] * x + slope[1] * y for x in (west, east) for y in (south, north))
    if lowest > base:
        assert mass.volume == pytest.approx(expected, rel=ROUNDING)
        assert mass.plan_area() == pytest.approx((east - west) * (north - south), rel=ROUNDING)
    assert mass.volume + rest.volume == pytest.approx(soil.volume, rel=ROUNDING)
    assert len(rim_edges(rest.mesh().triangles)) == 0


def test_faces_remember_their_origin():
    soil = ground(lambda x, y: 0.1 * x)
    floor = close_sheet(
        *height_field_sheet(np.array([-20.0, 20]), np.array([-20.0, 20]), np.full((2, 2), -2.0)), 30.0, SLIP_SURFACE
    )
    hole = rectangle(-1, -1, 1, 1)
    room = floor.common(upright_prism([rectangle(-4, -4, 4, 4), hole], -50, 50, PLAN))
    mesh = soil.without(room).mesh()
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1) / 2
    assert area[mesh.origins == SLIP_SURFACE].sum() == pytest.approx(64 - 4)
    assert (normals[mesh.origins == SLIP_SURFACE, 2] > 0).all()
    assert np.abs(normals[mesh.origins == PLAN, 2]).max() < ROUNDING
    # sides of the pit and of the island that stays in it, 2 m high on average
    assert area[mesh.origins == PLAN].sum() == pytest.approx(2 * (32 + 8))
    assert area[mesh.origins == GROUND].sum() == pytest.approx((400 - 60) * np.hypot(1, 0.1))
    assert (mesh.origins == SKIRT).any()


def test_open_surface_is_refused():
    vertices, triangles = height_field_sheet(np.arange(3.0), np.arange(3.0), np.zeros((3, 3)))
    with pytest.raises(ValueError, match="don't close a body"):
        closed_solid(vertices, [(triangles, GROUND)])


def test_rim_of_a_square():
    _, triangles = height_field_sheet(np.arange(4.0), np.arange(3.0), np.zeros((4, 3)))
    rim = rim_edges(triangles)
    assert len(rim) == 2 * (3 + 2)
    assert sorted(rim[:, 0]) == sorted(rim[:, 1])  # closed: each corner is left as often as it is reached


def test_parts_that_reach_down_lose_their_voids_and_what_floats_over_them():
    block = ground(lambda x, y: 0 * x + 8)
    void = upright_prism([rectangle(-3, -3, 3, 3)], -8, -4, PLAN)
    gap = upright_prism([rectangle(-11, -11, 11, 11)], 0, 5, PLAN)
    littered = block.without(void).without(gap)
    assert littered.volume == pytest.approx(20 * 20 * (20 + 3) - 36 * 4)
    left = littered.reaching(-15.0)
    assert left.volume == pytest.approx(20 * 20 * 20)
    assert left.mesh().vertices[:, 2].max() == pytest.approx(0)
