"""Planes and ellipsoids through points on them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.errors import ConfigurationError
from slideframe.release.fits import fit_ellipsoid, fit_plane

coordinate = st.floats(-100, 100)


def on_ellipsoid(centre, lengths, azimuth, count=12, seed=1):
    direction = np.random.default_rng(seed).normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    first, second, upright = (direction * lengths).T
    angle = np.radians(azimuth)
    along, across = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    return np.column_stack([np.outer(first, along) + np.outer(second, across), upright]) + centre


def height_on(centre, lengths, azimuth, x, y):
    angle = np.radians(azimuth)
    dx, dy = x - centre[0], y - centre[1]
    first, second = dx * np.sin(angle) + dy * np.cos(angle), dx * np.cos(angle) - dy * np.sin(angle)
    return centre[2] - lengths[2] * np.sqrt(1 - (first / lengths[0]) ** 2 - (second / lengths[1]) ** 2)


@given(slope=st.tuples(st.floats(-3, 3), st.floats(-3, 3), coordinate))
def test_plane_through_points_on_it(slope):
    points = np.array([[0, 0], [10, 1], [3, 12], [-5, 4]], float)
    points = np.column_stack([points, slope[0] * points[:, 0] + slope[1] * points[:, 1] + slope[2]])
    found, left = fit_plane(points, "points")
    np.testing.assert_allclose(found, slope, atol=1e-9)
    assert left < 1e-9


def test_plane_tells_how_far_off_it_is():
    points = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 1]], float)
    assert fit_plane(points, "points")[1] == pytest.approx(0.25)


def test_points_on_a_line_make_no_plane():
    with pytest.raises(ConfigurationError, match="on one line"):
        fit_plane(np.array([[0, 0, 0], [1, 1, 4], [2, 2, 5]], float), "[region.base] points")


@given(
    centre=st.tuples(coordinate, coordinate, coordinate),
    lengths=st.tuples(st.floats(5, 50), st.floats(5, 50), st.floats(5, 50)),
    azimuth=st.floats(0, 180),
)
def test_ellipsoid_through_points_on_it(centre, lengths, azimuth):
    centre, lengths = np.array(centre), np.array(lengths)
    points = on_ellipsoid(centre, lengths, azimuth)
    x, y = centre[0] + 0.3 * lengths.min(), centre[1] - 0.2 * lengths.min()
    expected = height_on(centre, lengths, azimuth, x, y)
    for ratio, count in ((None, 12), (tuple(lengths / lengths[0]), 4)):
        ellipsoid, left = fit_ellipsoid(points[:count], ratio, azimuth, "points")
        assert left < 1e-6
        assert ellipsoid.underside(np.array(x), np.array(y)) == pytest.approx(expected, abs=1e-4)
        assert np.isnan(ellipsoid.underside(np.array(centre[0] + 51), np.array(centre[1] + 51)))


@pytest.mark.parametrize("ratio", [None, (1.0, 1.0, 1.0)])
def test_no_ellipsoid_goes_through_a_plane(ratio):
    points = np.column_stack([np.random.default_rng(2).uniform(-5, 5, (9, 2)), np.zeros(9)])
    with pytest.raises(ConfigurationError, match="no ellipsoid goes through"):
        fit_ellipsoid(points, ratio, 0, "points")


def test_too_few_points():
    with pytest.raises(ConfigurationError, match="5 points don't determine") as caught:
        fit_ellipsoid(np.eye(5, 3), None, 0, "[region.base] points")
    assert "7 or more" in caught.value.cure
