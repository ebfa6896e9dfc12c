"""The written survey: files, metadata, truth, and the same bytes every time."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import ExifTags, Image

from slideframe.demo import DEMO_REGION, write_demo_survey
from slideframe.demo.flight import FLIGHT_MEAN, fly
from slideframe.demo.survey import MANIFEST, ORIGIN
from slideframe.errors import ConfigurationError
from slideframe.formats.rasters import read_raster
from slideframe.geodesy import enu_from_geodetic
from slideframe.problem import ReferenceGround
from slideframe.release.sampling import sample_heights

WIDTH, COUNT = 240, 4
DRONE = "{http://www.dji.com/drone-dji/1.0/}"
# XMP rounds degrees to 1e-9 (0.11 mm) and heights to 1 mm.
XMP_POSITION_TOLERANCE = 1e-3
# EXIF rounds to 1e-4 arc seconds (3 mm on the ground).
EXIF_DEGREE_TOLERANCE = 1.5e-8


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "survey"
    seen = []
    photographs = write_demo_survey(
        folder, width=WIDTH, photograph_count=COUNT, progress=lambda done, total: seen.append((done, total))
    )
    assert photographs == folder / "photographs"
    assert seen == [(done, COUNT) for done in range(COUNT + 1)]
    return folder


@pytest.fixture(scope="module")
def files(survey):
    return sorted((survey / "photographs").iterdir())


def drone_values(path):
    with Image.open(path) as image:
        root = ElementTree.fromstring(re.search(rb"<x:xmpmeta.*</x:xmpmeta>", image.info["xmp"], re.DOTALL)[0])
    return {
        key.removeprefix(DRONE): value
        for element in root.iter()
        for key, value in element.attrib.items()
        if key.startswith(DRONE)
    }


def test_pictures_have_the_size_asked_for_and_content(files):
    assert len(files) == COUNT
    for path in files:
        with Image.open(path) as image:
            assert image.size == (WIDTH, 180)
            pixels = np.asarray(image, np.float64)
        assert pixels.std() > 25  # a photograph of ground, not a grey card
        assert not (pixels == 255).all(axis=2).mean() > 0.02


def test_positions_and_angles_read_back(files):
    flight = fly(COUNT)
    for index, path in enumerate(files):
        values = drone_values(path)
        geodetic = np.array([[float(values[k]) for k in ("GpsLatitude", "GpsLongitude", "AbsoluteAltitude")]])
        position = enu_from_geodetic(geodetic, ORIGIN)[0]
        np.testing.assert_allclose(position, flight.reported_positions[index], atol=XMP_POSITION_TOLERANCE)
        angles = [float(values[f"Gimbal{name}Degree"]) for name in ("Yaw", "Pitch", "Roll")]
        np.testing.assert_allclose(angles, flight.reported_angles[index], atol=1e-9)
        sigma = [float(values[f"RtkStd{name}"]) for name in ("Lon", "Lat", "Hgt")]
        np.testing.assert_allclose(sigma, flight.position_sigma[index], atol=1e-5)
        assert values["RtkFlag"] == "50"
        assert float(values["RelativeAltitude"]) == pytest.approx(position[2] + FLIGHT_MEAN[2], abs=2e-3)


def test_exif_says_the_same_as_xmp(files):
    for path in files:
        values = drone_values(path)
        with Image.open(path) as image:
            exif = image.getexif()
            detail, gps = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
        assert (exif[ExifTags.Base.Make], exif[ExifTags.Base.Model]) == ("DJI", "M3E")
        assert float(detail[ExifTags.Base.FocalLength]) == pytest.approx(12.29)
        assert detail[ExifTags.Base.FocalLengthIn35mmFilm] == 24
        assert (detail[ExifTags.Base.ExifImageWidth], detail[ExifTags.Base.ExifImageHeight]) == (5280, 3956)
        for tag, name in ((ExifTags.GPS.GPSLatitude, "GpsLatitude"), (ExifTags.GPS.GPSLongitude, "GpsLongitude")):
            degrees, minutes, seconds = (float(part) for part in gps[tag])
            angle = degrees + minutes / 60 + seconds / 3600
            assert angle == pytest.approx(float(values[name]), abs=EXIF_DEGREE_TOLERANCE)
        assert float(gps[ExifTags.GPS.GPSAltitude]) == pytest.approx(float(values["AbsoluteAltitude"]), abs=1e-3)


def test_calibration_is_for_the_full_size(survey, files):
    values = drone_values(files[0])
    date, numbers = values["DewarpData"].split(";")
    fx, fy, cx, cy, *distortion = (float(number) for number in numbers.split(","))
    camera = json.loads((survey / "ground_truth/cameras.json").read_text())["camera"]
    scale = WIDTH / 5280
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    assert values["DewarpFlag"] == "0"
    np.testing.assert_allclose([fx * scale, fy * scale], [camera["focal_x"], camera["focal_y"]])
    expected = [(2640 + cx) * scale, (1978 + cy) * scale]
    np.testing.assert_allclose(expected, [camera["principal_x"], camera["principal_y"]])
    np.testing.assert_allclose(distortion, camera["distortion"])
    assert max(map(abs, distortion)) > 0.01


def test_truth_is_in_the_frame_of_the_region(survey, files):
    truth = json.loads((survey / "ground_truth/cameras.json").read_text())
    poses = np.array([truth["world_from_camera"][path.name] for path in files])
    np.testing.assert_allclose(poses[:, :, 3].mean(axis=0), 0, atol=1e-9)
    terrain = np.load(survey / "ground_truth/terrain.npz")
    x, y, heights = terrain["x"], terrain["y"], terrain["heights"]
    assert terrain["reflectance"].shape == (3, *heights.shape)
    region = DEMO_REGION
    inside = heights[
        np.ix_((y > region["y_min"]) & (y < region["y_max"]), (x > region["x_min"]) & (x < region["x_max"]))
    ]
    # a slope of some 30 m stands over the base, and the road lies just below it
    assert 25 < inside.max() - region["z_min"] < 36
    road = heights[np.abs(y + 5.8).argmin(), np.abs(x).argmin()]
    assert -0.3 < road - region["z_min"] < 0


def test_same_options_give_the_same_bytes(survey, tmp_path):
    write_demo_survey(tmp_path / "again", width=WIDTH, photograph_count=COUNT)
    first = {path.relative_to(survey): path.read_bytes() for path in survey.rglob("*") if path.is_file()}
    again = tmp_path / "again"
    assert first == {path.relative_to(again): path.read_bytes() for path in again.rglob("*") if path.is_file()}


def test_a_finished_survey_is_left_and_another_replaced(survey, tmp_path):
    stamps = {path: path.stat().st_mtime_ns for path in survey.rglob("*")}
    write_demo_survey(survey, width=WIDTH, photograph_count=COUNT)
    assert stamps == {path: path.stat().st_mtime_ns for path in survey.rglob("*")}
    stale = tmp_path / "stale"
    stale.mkdir()
    (stale / MANIFEST).write_text('{"generator_version": 0}')
    photographs = write_demo_survey(stale, width=64, photograph_count=3)
    assert len(list(photographs.iterdir())) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["stale"]


def test_a_folder_of_something_else_is_not_touched(tmp_path):
    (tmp_path / "diary.txt").write_text("mine")
    with pytest.raises(ConfigurationError, match="holds no demo survey"):
        write_demo_survey(tmp_path, width=64, photograph_count=3)
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


@pytest.mark.parametrize(
    ("options", "where"), [({"width": 10}, "width"), ({"photograph_count": 99}, "photograph_count")]
)
def test_impossible_options_are_refused(tmp_path, options, where):
    with pytest.raises(ConfigurationError) as caught:
        write_demo_survey(tmp_path / "survey", **options)
    assert caught.value.where == where
    assert not list(tmp_path.iterdir())


def test_height_model_is_the_truth_on_the_map(survey):
    """Read as any user's lidar would be, it has the true heights in the survey's frame."""
    terrain = np.load(survey / "ground_truth/terrain.npz")
    path = survey / "ground_truth/terrain.asc"
    rows, columns = np.random.default_rng(3).integers(20, len(terrain["x"]) - 20, (2, 2000))
    points = np.column_stack([terrain["x"][columns], terrain["y"][rows], terrain["heights"][rows, columns]])
    given = ReferenceGround(path=path, epsg=4326)
    difference = sample_heights(read_raster(path), given, points.astype(np.float64), ORIGIN, str(path)) - points[:, 2]
    # between its cells a height model knows no edge of a boulder; most of the ground is smooth
    assert np.median(np.abs(difference)) < 0.005
    assert abs(difference.mean()) < 0.005
    assert np.abs(difference).max() < 1.0
