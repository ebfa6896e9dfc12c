import csv
from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import ConfigurationError
from slideframe.formats.position_table import write_position_table
from slideframe.geodesy import enu_from_geodetic
from slideframe.georeferencing import Heights, to_local
from slideframe.products import Camera, Georeference, Photograph, Survey

ORIGIN = Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=150.0)
CENTERS = np.array([[0.0, 0.0, 0.0], [120.5, -80.25, 33.125]])
PRINTED = 2e-4  # m


@pytest.fixture
def survey(tmp_path: Path) -> Survey:
    poses = np.tile(np.eye(3, 4), (2, 1, 1))
    poses[:, :, 3] = CENTERS
    photographs = [Photograph(path=tmp_path / name, camera=0, sha256="0" * 64) for name in ("a/1.JPG", "b/2.JPG")]
    return Survey(
        georeference=ORIGIN,
        cameras=(Camera(width=4, height=3, focal_x=4.0, focal_y=4.0, principal_x=2.0, principal_y=1.5),),
        photographs=tuple(photographs),
        world_from_camera=poses,
        position_sigma=np.array([[0.01, 0.02, 0.03], [1.0, 2.0, 3.0]]),
        sparse_points=np.zeros((0, 3), np.float32),
        sparse_colors=np.zeros((0, 3), np.uint8),
        sparse_errors=np.zeros(0, np.float32),
    )


def rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_degrees_of_wgs84(survey: Survey, tmp_path: Path) -> None:
    write_position_table(survey, tmp_path / "positions.csv")
    read = rows(tmp_path / "positions.csv")
    names = ("latitude", "longitude", "ellipsoidal_height")
    places = np.array([[float(row[name]) for name in names] for row in read])
    np.testing.assert_allclose(enu_from_geodetic(places, ORIGIN), CENTERS, atol=PRINTED)
    assert [row["name"] for row in read] == ["a/1.JPG", "b/2.JPG"]
    assert [float(read[1][f"sigma_{axis}"]) for axis in ("east", "north", "up")] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("heights", [Heights(), Heights(epsg=5738, geoid_offset=-2.4)])
def test_eastings_and_northings(survey: Survey, tmp_path: Path, heights: Heights) -> None:
    pytest.importorskip("pyproj")
    write_position_table(survey, tmp_path / "positions.csv", 2326, heights)
    height = "ellipsoidal_height" if heights.ellipsoidal else "orthometric_height"
    places = np.array(
        [[float(row[name]) for name in ("easting", "northing", height)] for row in rows(tmp_path / "positions.csv")]
    )
    np.testing.assert_allclose(to_local(places, 2326, ORIGIN, heights), CENTERS, atol=PRINTED)


def test_degrees_are_no_eastings(survey: Survey, tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    with pytest.raises(ConfigurationError, match="EPSG:4326 has no eastings"):
        write_position_table(survey, tmp_path / "positions.csv", 4326)
