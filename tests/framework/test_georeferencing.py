"""Coordinate systems by EPSG code, against formulas and PROJ's own words."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from slideframe.errors import ConfigurationError, InputError, MissingDependency
from slideframe.geodesy import enu_from_geodetic
from slideframe.georeferencing import Heights, from_geodetic, from_local, stated_accuracy, to_geodetic, to_local
from slideframe.products import Georeference

pyproj = pytest.importorskip("pyproj")

ROUND_TRIP = 1e-6  # m; the survey asks for 1 mm, and these systems' coordinates are rounded at 1e-9 m
HONG_KONG = Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=150.0)
HKPD = Heights(epsg=5738, geoid_offset=-2.4)
TURIN = Georeference(latitude=45.0315, longitude=7.6206, ellipsoidal_height=349.5)
METRES = [-3000.0, 3000.0]


@settings(max_examples=40)
@given(
    system=st.sampled_from([(2326, HONG_KONG), (32650, HONG_KONG), (4326, HONG_KONG), (32632, TURIN), (25832, TURIN)]),
    points=st.lists(st.tuples(st.floats(*METRES), st.floats(*METRES), st.floats(-300, 3000)), min_size=1, max_size=4),
    offset=st.none() | st.floats(-100, 90),
)
def test_there_and_back(system, points, offset) -> None:
    epsg, origin = system
    local = np.array(points)
    vertical = Heights(geoid_offset=offset)
    np.testing.assert_allclose(
        to_local(from_local(local, epsg, origin, vertical), epsg, origin, vertical), local, atol=ROUND_TRIP, rtol=0
    )


def test_hong_kong_grid_with_principal_datum_heights() -> None:
    """The horizontal part is PROJ's with the true height; heights are ellipsoidal less the undulation."""
    place = np.array([[22.3123, 114.1786, 61.5]])
    x, y, height = from_geodetic(place, 2326, HKPD)[0]
    expected = pyproj.Transformer.from_crs(4979, 2326, always_xy=True).transform(114.1786, 22.3123, 61.5)
    assert (x, y) == pytest.approx(expected[:2], abs=1e-9)
    assert height == pytest.approx(61.5 + 2.4, abs=1e-12)
    assert stated_accuracy(2326, HONG_KONG) == 1.0


def test_the_false_origin_of_the_hong_kong_grid() -> None:
    """The Lands Department's rule of thumb: WGS84 latitude is HK80's less 5.5", longitude HK80's plus 8.8"."""
    latitude, longitude = 22 + 18 / 60 + 43.68 / 3600 - 5.5 / 3600, 114 + 10 / 60 + 42.80 / 3600 + 8.8 / 3600
    x, y, _ = from_geodetic(np.array([[latitude, longitude, 0.0]]), 2326)[0]
    assert (x, y) == pytest.approx((836_694.05, 819_069.80), abs=3.0)  # a tenth of a second is 3 m


def test_projected_axes_are_not_taken_for_east_and_north() -> None:
    """UTM's north is 0.97 degrees off true north here: 150 m from the origin that is 2.5 m."""
    start, ahead = from_local(np.array([[0.0, 0.0, 0.0], [0.0, 150.0, 0.0]]), 32632, TURIN)
    convergence = np.degrees(np.arctan2(*(ahead - start)[:2]))
    expected = np.degrees(np.radians(7.6206 - 9.0) * np.sin(np.radians(45.0315)))  # to first order
    assert convergence == pytest.approx(-expected, abs=0.01)


def test_outlines_lie_at_the_origins_height() -> None:
    corners = np.array([[836_700.0, 819_100.0], [837_000.0, 819_400.0]])
    local = to_local(corners, 2326, HONG_KONG)
    assert local.shape == (2, 2)
    raised = to_local(np.column_stack([corners, [150.0, 150.0]]), 2326, HONG_KONG)
    np.testing.assert_allclose(local, raised[:, :2], atol=0.01)


def test_geographic_points_are_longitude_then_latitude() -> None:
    local = to_local(np.array([[114.201, 22.3, 150.0]]), 4326, HONG_KONG)
    np.testing.assert_allclose(local, enu_from_geodetic(np.array([[22.3, 114.201, 150.0]]), HONG_KONG), atol=ROUND_TRIP)


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    """A geoid model in the GTX format: 3 x 3 nodes around Hong Kong, 0.5 degrees apart, planes in between."""
    path = tmp_path / "a geoid.gtx"
    values = [-2.0, -1.5, -1.0, -2.2, -1.7, -1.2, -2.4, -1.9, -1.4]
    path.write_bytes(struct.pack(">4d2i9f", 21.8, 113.7, 0.5, 0.5, 3, 3, *values))
    return path


def test_a_grid_of_undulations_is_interpolated(grid: Path) -> None:
    vertical = Heights(geoid_grid=grid)
    place = np.array([[22.3, 114.2, 100.0], [22.55, 114.45, 100.0]])
    heights = from_geodetic(place, 2326, vertical)[:, 2]
    np.testing.assert_allclose(heights, [100 + 1.7, 100 + (1.7 + 1.2 + 1.9 + 1.4) / 4], atol=1e-5)  # float32 nodes
    local = np.array([[10.0, 20.0, 30.0], [-2000.0, 900.0, 500.0]])
    there = from_local(local, 2326, HONG_KONG, vertical)
    np.testing.assert_allclose(to_local(there, 2326, HONG_KONG, vertical), local, atol=ROUND_TRIP)


def test_a_grid_that_is_no_grid_or_lies_elsewhere(grid: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="geoid grid") as caught:
        from_local(np.zeros((1, 3)), 32632, TURIN, Heights(geoid_grid=grid))
    assert str(grid) in str(caught.value)
    text = tmp_path / "text.gtx"
    text.write_text("no grid")
    for path in (text, tmp_path / "absent.gtx"):
        with pytest.raises(InputError, match="geoid grid"):
            from_local(np.zeros((1, 3)), 2326, HONG_KONG, Heights(geoid_grid=path))


def test_no_guess_where_a_grid_is_missing() -> None:
    installed = pyproj.transformer.TransformerGroup(4979, "EPSG:4326+5773", allow_ballpark=False).transformers
    if installed:
        pytest.skip("PROJ's EGM96 grid is installed here")
    with pytest.raises(MissingDependency, match=r"us_nga_egm96_15\.tif") as caught:
        from_local(np.zeros((1, 3)), 4326, HONG_KONG, Heights(epsg=5773))
    assert "geoid_offset" in caught.value.cure


def test_no_guess_where_proj_knows_no_grid() -> None:
    with pytest.raises(ConfigurationError, match=r"HKPD height.*only guesses"):
        from_local(np.zeros((1, 3)), 2326, HONG_KONG, Heights(epsg=5738))


@pytest.mark.parametrize(
    ("epsg", "vertical", "what"),
    [
        (99999, Heights(), "doesn't know EPSG:99999"),
        (2326, Heights(epsg=4326), "isn't a vertical system"),
        (5738, Heights(), "neither a projected nor a geographic"),
        (4978, Heights(), "neither a projected nor a geographic"),
        (4979, Heights(geoid_offset=1.0), "heights of its own"),
    ],
)
def test_codes_that_cannot_be_used(epsg: int, vertical: Heights, what: str) -> None:
    with pytest.raises(ConfigurationError, match=what):
        from_local(np.zeros((1, 3)), epsg, HONG_KONG, vertical)


def test_a_system_made_for_elsewhere() -> None:
    with pytest.raises(InputError, match="British National Grid is made for"):
        from_local(np.zeros((1, 3)), 27700, HONG_KONG)


@pytest.mark.parametrize("swapped", [[22.3, 114.2, 0.0], [819_069.0, 836_694.0, 0.0]])
def test_swapped_coordinates_are_noticed(swapped: list[float]) -> None:
    epsg = 4326 if swapped[1] < 200 else 2326
    with pytest.raises(InputError, match=r"before y \(northing or latitude\)"):
        to_local(np.array([swapped]), epsg, HONG_KONG)


def test_nothing_in_nothing_out() -> None:
    assert to_geodetic(np.zeros((0, 3)), 2326).shape == from_geodetic(np.zeros((0, 3)), 2326).shape == (0, 3)


def test_one_undulation_only(grid: Path) -> None:
    with pytest.raises(ValidationError, match="not both"):
        Heights(geoid_offset=1.0, geoid_grid=grid)


def test_pyproj_is_asked_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(MissingDependency, match="pyproj"):
        from_local(np.zeros((1, 3)), 2326, HONG_KONG)
