"""WGS84 conversions against closed-form facts and, where installed, PROJ."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.geodesy import ecef_from_geodetic, enu_from_geodetic, geodetic_from_ecef, geodetic_from_enu
from slideframe.products import Georeference

# float64 carries earth radii to 1e-9 m; a few operations are allowed for.
ROUNDING = 1e-8


def test_axes_of_the_ellipsoid():
    points = np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 90.0, 10.0]])
    expected = [[6378137.0, 0, 0], [0, 0, 6356752.314245179], [0, 6378147.0, 0]]
    np.testing.assert_allclose(ecef_from_geodetic(points), expected, atol=ROUNDING)


@given(
    latitude=st.floats(-89.9, 89.9), longitude=st.floats(-179.9, 179.9), height=st.floats(-400, 9000),
    east=st.floats(-2000, 2000), north=st.floats(-2000, 2000), up=st.floats(-500, 500),
)  # fmt: skip
def test_there_and_back(latitude, longitude, height, east, north, up):
    origin = Georeference(latitude=latitude, longitude=longitude, ellipsoidal_height=height)
    points = np.array([[east, north, up]])
    np.testing.assert_allclose(enu_from_geodetic(geodetic_from_enu(points, origin), origin), points, atol=ROUNDING)


def test_equals_proj():
    pyproj = pytest.importorskip("pyproj")
    points = np.array([[22.2809, 114.2196, 148.4], [-33.1, -70.6, 3200.0], [61.5, 8.3, -2.0]])
    proj = pyproj.Transformer.from_crs(4979, 4978).transform(*points.T)
    np.testing.assert_allclose(ecef_from_geodetic(points), np.column_stack(proj), atol=ROUNDING)
    np.testing.assert_allclose(geodetic_from_ecef(np.column_stack(proj)), points, atol=ROUNDING)
