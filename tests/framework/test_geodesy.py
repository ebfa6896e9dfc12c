"""WGS84 conversions against closed-form facts and, where installed, PROJ."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.geodesy import (
    ecef_from_geodetic,
    enu_from_geodetic,
    geodetic_from_ecef,
    geodetic_from_enu,
    mean_origin,
)
from slideframe.products import Georeference

# float64 carries earth radii to 1e-9 m; a few operations are allowed for.
ROUNDING = 1e-8
METERS_PER_DEGREE = 111_000.0

ORIGINS = st.builds(
    Georeference,
    latitude=st.floats(-89.9, 89.9),
    longitude=st.floats(-179.9, 179.9),
    ellipsoidal_height=st.floats(-400, 9000),
)
OFFSETS = st.lists(
    st.tuples(st.floats(-10_000, 10_000), st.floats(-10_000, 10_000), st.floats(-3000, 3000)), min_size=1, max_size=5
)


def test_axes_of_the_ellipsoid():
    points = np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 90.0, 10.0]])
    expected = [[6378137.0, 0, 0], [0, 0, 6356752.314245179], [0, 6378147.0, 0]]
    np.testing.assert_allclose(ecef_from_geodetic(points), expected, atol=ROUNDING)


@given(ORIGINS, OFFSETS)
def test_there_and_back(origin, offsets):
    points = np.array(offsets)
    np.testing.assert_allclose(enu_from_geodetic(geodetic_from_enu(points, origin), origin), points, atol=ROUNDING)


def test_equals_proj():
    pyproj = pytest.importorskip("pyproj")
    points = np.array([[22.2809, 114.2196, 148.4], [-33.1, -70.6, 3200.0], [61.5, 8.3, -2.0]])
    proj = pyproj.Transformer.from_crs(4979, 4978).transform(*points.T)
    np.testing.assert_allclose(ecef_from_geodetic(points), np.column_stack(proj), atol=ROUNDING)
    np.testing.assert_allclose(geodetic_from_ecef(np.column_stack(proj)), points, atol=ROUNDING)


@given(ORIGINS, OFFSETS)
def test_the_local_frame_is_projs_topocentric_one(origin, offsets):
    """EPSG's method 9837: axes true east, true north and the ellipsoid's normal at the origin."""
    pyproj = pytest.importorskip("pyproj")
    place = f"+lon_0={origin.longitude!r} +lat_0={origin.latitude!r} +h_0={origin.ellipsoidal_height!r}"
    topocentric = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
        f" +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 {place}"
    )
    latitude, longitude, height = geodetic_from_enu(np.array(offsets), origin).T
    proj = np.column_stack(topocentric.transform(longitude, latitude, height))
    np.testing.assert_allclose(proj, offsets, atol=ROUNDING)


@given(st.floats(-70, 70), st.floats(-180, 180), st.floats(-0.01, 0.01))
def test_the_mean_lies_among_the_positions_even_at_the_date_line(latitude, longitude, half):
    longitudes = (np.array([longitude - half, longitude + half]) + 180) % 360 - 180
    places = np.column_stack([[latitude, latitude], longitudes, [90.0, 110.0]])
    local = enu_from_geodetic(places, mean_origin(places))
    assert abs(local[:, :2]).max() < (abs(half) + 1e-9) * METERS_PER_DEGREE * 1.01
    assert local[:, 2].mean() == pytest.approx(0.0, abs=0.1)  # the ellipsoid falls away below the tangent plane
