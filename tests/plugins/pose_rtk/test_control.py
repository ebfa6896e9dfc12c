"""The file of surveyed points, and where photographs see them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, InputError
from slideframe.geodesy import geodetic_from_enu
from slideframe.georeferencing import Heights, from_geodetic
from slideframe.products import Camera, Georeference
from slideframe_pose_rtk.control import ControlFile, Target, read_targets
from slideframe_pose_rtk.orientation import world_from_camera
from slideframe_pose_rtk.sighted import compare

HONG_KONG = Georeference(latitude=22.28, longitude=114.17, ellipsoidal_height=60.0)
ITALY = Georeference(latitude=45.03, longitude=7.62, ellipsoidal_height=350.0)
PLACES = np.array([[12.5, -30.25, 4.0], [-8.0, 14.0, -2.5]])


class Flight(SimpleNamespace):
    """As much of a flight as the reader looks at."""

    def __len__(self) -> int:
        return 3

    def name(self, index: int) -> str:
        return f"strip/{index}.jpg"


def flight(origin: Georeference) -> Flight:
    return Flight(georeference=origin, records=[SimpleNamespace(path=Path(f"strip/{index}.jpg")) for index in range(3)])


def write(path: Path, header: str, *rows: str) -> Path:
    path.write_text("\n".join([header, *rows]))
    return path


def test_degrees_come_into_the_local_frame(tmp_path: Path) -> None:
    rows = [
        f"P{number};{'check' if number else ''};{latitude:.11f};{longitude:.11f};{height:.5f};{photograph};100.5;{row}"
        for number, (latitude, longitude, height) in enumerate(geodetic_from_enu(PLACES, ITALY))
        for photograph, row in (("0.jpg", 20.5), ("strip/2.jpg", 30.5))
    ]
    table = write(tmp_path / "p.csv", "name;role;latitude;longitude;ellipsoidal_height;photograph;column;row", *rows)
    targets = read_targets(ControlFile(table), flight(ITALY))
    assert [(target.name, target.role) for target in targets] == [("P0", "control"), ("P1", "check")]
    np.testing.assert_allclose([target.position for target in targets], PLACES, atol=1e-4)
    assert targets[0].sightings == {0: (100.5, 20.5), 2: (100.5, 30.5)}


def test_a_national_grid_and_heights_above_the_sea(tmp_path: Path) -> None:
    """HK1980 grid with HKPD 1.2 m above the ellipsoid at the site."""
    geodetic = geodetic_from_enu(PLACES, HONG_KONG)
    grid = from_geodetic(geodetic, 2326, Heights(geoid_offset=1.2))
    rows = [f"P{i},{x:.4f},{y:.4f},{h:.4f},0.jpg,1,1" for i, (x, y, h) in enumerate(grid)]
    table = write(tmp_path / "p.csv", "name,easting,northing,orthometric_height,photograph,column,row", *rows)
    known = ControlFile(table, 2326, Heights(geoid_offset=1.2))
    targets = read_targets(known, flight(HONG_KONG))
    np.testing.assert_allclose([target.position for target in targets], PLACES, atol=1e-3)
    with pytest.raises(ConfigurationError, match="orthometric"):
        read_targets(ControlFile(table, 2326), flight(HONG_KONG))
    with pytest.raises(ConfigurationError, match="coordinate system"):
        read_targets(ControlFile(table), flight(HONG_KONG))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["A,45.03,7.62,x,0.jpg,1,1"], "line 2.*'x' in ellipsoidal_height"),
        (["A,45.03,7.62,350,0.jpg,1,1", "A,45.04,7.62,350,1.jpg,1,1"], "line 3.*another place"),
        (["A,45.03,7.62,350,9.jpg,1,1"], "none of the photographs"),
        (["A,45.03,7.62,350,0.jpg,,1"], "line 2.*column is no number"),
        ([",45.03,7.62,350,0.jpg,1,1"], "line 2.*no name"),
    ],
)
def test_faults_are_named_by_line(tmp_path: Path, rows: list[str], message: str) -> None:
    table = write(tmp_path / "p.csv", "name,latitude,longitude,ellipsoidal_height,photograph,column,row", *rows)
    with pytest.raises(InputError, match=message):
        read_targets(ControlFile(table), flight(ITALY))


def test_missing_columns_are_an_error_with_the_cure(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its columns are name, latitude") as error:
        read_targets(ControlFile(write(tmp_path / "p.csv", "name,latitude", "A,45")), flight(ITALY))
    assert "a line for each sighting" in str(error.value)


@pytest.mark.parametrize("system", ["EPSG:32632", "WGS84 UTM 32N", "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"])
def test_opendronemaps_list_says_its_system_itself(tmp_path: Path, system: str) -> None:
    grid = from_geodetic(geodetic_from_enu(PLACES, ITALY), 32632)
    rows = [f"{x:.4f} {y:.4f} {h:.4f} 10.5 20.5 {i}.jpg{' GCP1' * (i == 1)}" for i, (x, y, h) in enumerate(grid)]
    targets = read_targets(ControlFile(write(tmp_path / "gcp_list.txt", system, *rows)), flight(ITALY))
    np.testing.assert_allclose([target.position for target in targets], PLACES, atol=1e-3)
    assert targets[1].name == "GCP1"
    assert targets[1].sightings == {1: (10.5, 20.5)}
    assert {target.role for target in targets} == {"control"}


def test_opendronemaps_list_in_degrees_above_the_sea(tmp_path: Path) -> None:
    rows = [
        f"{longitude:.10f} {latitude:.10f} {height - 48.5:.4f} 1 1 {i}.jpg"
        for i, (latitude, longitude, height) in enumerate(geodetic_from_enu(PLACES, ITALY))
    ]
    table = write(tmp_path / "gcp_list.txt", "EPSG:4326", *rows)
    targets = read_targets(ControlFile(table, geoid=Heights(geoid_offset=48.5)), flight(ITALY))
    np.testing.assert_allclose([target.position for target in targets], PLACES, atol=1e-3)


@pytest.mark.parametrize(
    ("lines", "message"),
    [(["some grid", "1 2 3 4 5 a.jpg"], "'some grid'"), (["EPSG:32632", "1 2 3"], "line 2 has 3 fields")],
)
def test_faults_of_opendronemaps_list_are_named(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_targets(ControlFile(write(tmp_path / "gcp_list.txt", *lines)), flight(ITALY))


LENS = Camera(
    width=800, height=600, focal_x=550, focal_y=560, principal_x=390, principal_y=310,
    distortion=(-0.1, 0.02, 1e-3, -2e-3, 0.0),
)  # fmt: skip


def test_a_point_is_where_its_rays_meet() -> None:
    """Three views of one place, through a lens with distortion, against the place itself."""
    place = np.array([1.0, 2.0, 3.0])
    poses = {
        index: np.column_stack([world_from_camera(yaw, -70.0, 0.0), place + offset])
        for index, (yaw, offset) in enumerate([(10, [-3, -15, 40]), (100, [-14, 3, 42]), (200, [5, 15, 38])])
    }
    from slideframe_pose_rtk.sighted import _project

    views = [(pose, LENS) for pose in poses.values()]
    sightings = {index: tuple(pixel) for index, pixel in enumerate(_project(place, views))}
    surveyed = place + np.array([0.05, -0.02, 0.1])
    cameras = {0: 0, 1: 0, 2: 0}
    (found,) = compare([Target("A", "check", surveyed, sightings)], poses, [LENS], cameras)
    np.testing.assert_allclose(found.residual, place - surveyed, atol=1e-6)
    assert found.reprojection_error == pytest.approx(0.0, abs=1e-6)
    (single,) = compare([Target("A", "check", surveyed, {0: sightings[0]})], poses, [LENS], cameras)
    assert single.residual is None, "one ray has no end"
    same = {0: poses[0], 1: poses[0]}
    twice = {0: sightings[0], 1: sightings[0]}
    (parallel,) = compare([Target("A", "check", surveyed, twice)], same, [LENS], cameras)
    assert parallel.residual is None, "two equal rays meet everywhere"
