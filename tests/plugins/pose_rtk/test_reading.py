import csv
import json
import math
import shutil
import subprocess
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from slideframe.errors import InputError
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.orientation import world_from_camera
from slideframe_pose_rtk.reading import read_record

PRINTED_DEGREES = 5e-10  # the expected values are printed to nine decimals
EXIF_DEGREES = 2e-8  # EXIF's ten thousandth of a second

# file, latitude, longitude, height, datum, gimbal, fix; as exiftool prints them
SAMPLES = [
    ("dji_p4m_rtkflag50_fixed", 45.03159568, 7.62046587, 349.58, "ellipsoidal", (106.8, -90.0, 0.0), "fixed"),
    (
        "dji_p4m_rtkflag50_exiftool_rewritten_elements",
        *(45.03159568, 7.62046587, 349.58),
        *("ellipsoidal", (106.8, -90.0, 0.0), "fixed"),
    ),
    ("dji_phantom3_FC300S", 46.8426070833, -91.9945598889, 198.31, "unknown", (45.0, -89.9, 0.0), "none"),
    ("dji_L1D-20c_mavic2pro_Test_Pro", 47.3541841, 10.1913155, 1252.12, "unknown", (-127.1, 1.0, 0.0), "none"),
    ("dji_XT2_FLIR_negative_alt", 40.3775014444, -74.4899133611, -8.56, "unknown", (-78.8, -89.9, 0.0), "none"),
    ("dji_ZH20T_gpsfusion", 40.5637811, -79.7649628, 221.404, "unknown", (32.5, -10.5, 0.0), "none"),
    (
        "dji_mini4pro_FC8482_DJI_20251001213509_0003_D_LENS_CAP",
        *(-8.30395, 115.48415, 1189.641, "unknown", None, "none"),
    ),
    (
        "dji_mini4pro_FC8482_DJI_20251001132715_0396_D_POOR_SHARPNESS",
        *(-8.30396, 115.48416, None, "unknown", None, "none"),
    ),
    (
        "parrot_sequoia_XMP-Camera",
        *(49.1865473333, 1.6555131667, 162.7000001, "orthometric"),
        *((-168.784214, -76.754851, 1.650674), "none"),
    ),
]


@pytest.mark.parametrize(("name", "latitude", "longitude", "height", "datum", "gimbal", "fix"), SAMPLES)
def test_real_cameras(shared: Path, name, latitude, longitude, height, datum, gimbal, fix) -> None:
    record = read_record(shared / "data" / "metadata_samples" / f"{name}.jpg")
    assert record.latitude == pytest.approx(latitude, abs=PRINTED_DEGREES)
    assert record.longitude == pytest.approx(longitude, abs=PRINTED_DEGREES)
    assert record.height == (None if height is None else pytest.approx(height, abs=1e-6))
    assert (record.altitude_kind, record.fix) == (datum, fix)
    assert record.gimbal == (None if gimbal is None else pytest.approx(gimbal, abs=1e-6))


def exiftool(files: list[Path]) -> list[dict]:
    """Read everything that exiftool knows, by group and name."""
    command = ["exiftool", "-json", "-n", "-a", "-G1", *map(str, files)]
    return json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


# Ours against exiftool's, in its words: group and name, and how ours is to be read.
DRONE = "XMP-drone-dji:"
ORACLE = {
    "make": ("XMP-tiff:Make", str),
    "model": ("IFD0:Model", str),
    "local_time": ("ExifIFD:DateTimeOriginal", lambda time: str(time)[:19].replace("-", ":")),
    "exposure_time": ("ExifIFD:ExposureTime", float),
    "focal_length": ("ExifIFD:FocalLength", float),
    "focal_length_35mm": ("ExifIFD:FocalLengthIn35mmFormat", float),
    "height_above_takeoff": (f"{DRONE}RelativeAltitude", float),
    "rtk_flag": (f"{DRONE}RtkFlag", int),
    "calibrated_focal_length": (f"{DRONE}CalibratedFocalLength", float),
    "full_size.0": ("ExifIFD:ExifImageWidth", int),
    "full_size.1": ("ExifIFD:ExifImageHeight", int),
    "size.0": ("File:ImageWidth", int),
    "size.1": ("File:ImageHeight", int),
    "gimbal.0": (f"{DRONE}GimbalYawDegree", float),
    "gimbal.1": (f"{DRONE}GimbalPitchDegree", float),
    "gimbal.2": (f"{DRONE}GimbalRollDegree", float),
    "rtk_sigma.0": (f"{DRONE}RtkStdLon", float),
    "rtk_sigma.1": (f"{DRONE}RtkStdLat", float),
    "rtk_sigma.2": (f"{DRONE}RtkStdHgt", float),
    "optical_center.0": (f"{DRONE}CalibratedOpticalCenterX", float),
    "optical_center.1": (f"{DRONE}CalibratedOpticalCenterY", float),
}


def ours(record: PhotoRecord, name: str) -> object:
    field, _, index = name.partition(".")
    value = getattr(record, field)
    return value[int(index)] if index and value is not None else value


@pytest.mark.skipif(not shutil.which("exiftool"), reason="exiftool isn't installed; the table above is its reading")
def test_agrees_with_exiftool(shared: Path) -> None:
    files = sorted((shared / "data" / "metadata_samples").glob("*.jpg"))
    compared = 0
    for path, told in zip(files, exiftool(files), strict=True):
        record = read_record(path)
        for name, (tag, form) in ORACLE.items():
            if tag not in told or told[tag] == "undef":
                continue
            value = ours(record, name)
            if value is None and name.startswith("gimbal"):
                continue  # one angle alone is no orientation
            expected = form(told[tag])
            expected = expected if isinstance(expected, str) else pytest.approx(expected, rel=1e-8)
            assert form(value) == expected, (path.name, name)
            compared += 1
        for name, sign in (("latitude", "S"), ("longitude", "W")):
            tag = f"GPS{name.title()}"
            in_exif = told[f"GPS:{tag}"] * (-1 if told.get(f"GPS:{tag}Ref") == sign else 1)
            expected = pytest.approx(float(told.get(DRONE + tag, in_exif)), abs=PRINTED_DEGREES)
            assert getattr(record, name) == expected, path.name
        height = float(told.get(f"{DRONE}AbsoluteAltitude", told.get("GPS:GPSAltitude", "nan")))
        assert (math.isnan(height) and record.height is None) or record.height == pytest.approx(height, abs=1e-6)
        serials = {told.get(f"ExifIFD:{tag}") for tag in ("SerialNumber", "LensSerialNumber")}
        assert record.serial in serials | {told.get(f"{DRONE}DroneID"), ""}
    assert compared > 100, "nothing was compared"


@pytest.mark.skipif(not shutil.which("exiftool"), reason="exiftool isn't installed; the next test needs none")
def test_the_writer_of_these_tests_tells_exiftool_the_truth(tmp_path: Path, photograph, drone_metadata) -> None:
    """Else records that come back as written might be written and read wrongly alike."""
    path = photograph(tmp_path / "a.jpg", drone_metadata(22.28, -114.2, 150.25, yaw=12.5, pitch=-60.5))
    (told,) = exiftool([path])
    assert (float(told[f"{DRONE}GPSLatitude"]), float(told[f"{DRONE}GPSLongitude"])) == (22.28, -114.2)
    names = ("AbsoluteAltitude", "GimbalYawDegree", "GimbalPitchDegree", "RtkFlag", "RtkStdLon")
    assert [float(told[DRONE + name]) for name in names] == [150.25, 12.5, -60.5, 50, 0.01]
    assert told["ExifIFD:FocalLengthIn35mmFormat"] == 24


def test_a_whole_flight_to_the_printed_digits(shared: Path) -> None:
    from slideframe.geodesy import enu_from_geodetic, mean_origin

    flight = shared / "data" / "uav" / "mirafiori_rtk"
    rows = list(csv.DictReader((flight / "reference" / "metadata_expected.csv").read_text().splitlines()))
    records = [read_record(flight / "images" / row["name"]) for row in rows]
    places = np.array([(record.latitude, record.longitude, record.height) for record in records])
    local = enu_from_geodetic(places, mean_origin(places))
    for row, record, position in zip(rows, records, local, strict=True):
        assert f"{record.latitude:.9f} {record.longitude:.9f}" == f"{row['lat']} {row['lon']}"
        assert record.height == float(row["alt_as_written"])
        assert record.gimbal == tuple(float(row[f"gimbal_{axis}"]) for axis in ("yaw", "pitch", "roll"))
        assert record.rtk_sigma == tuple(float(row[f"std_{axis}"]) for axis in ("lon", "lat", "hgt"))
        assert (record.rtk_flag, record.size) == (int(row["rtk_flag"]), (int(row["width"]), int(row["height"])))
        np.testing.assert_allclose(position, [float(row[axis]) for axis in "ENU"], atol=5.1e-5)
        # COLMAP's translation is -R^T C
        translation = -world_from_camera(*record.gimbal).T @ position
        np.testing.assert_allclose(translation, [float(row[f"t{axis}"]) for axis in "xyz"], atol=1e-6)


DIGITS = 6  # that the random records below are written with
RECORDS = st.fixed_dictionaries(
    {
        "maker": st.sampled_from(["dji", "autel", "parrot", "skydio", "pix4d"]),
        "spelling": st.sampled_from(["GpsLongitude", "GpsLongtitude", "GPSLongitude", "Longitude"]),
        "latitude": st.floats(-89, 89),
        "longitude": st.floats(-179, 179),
        "height": st.floats(-500, 9000),
        "yaw": st.floats(-180, 180),
        "pitch": st.floats(-119, 30),
        "roll": st.floats(-45, 45),
        "flag": st.sampled_from([0, 16, 32, 34, 49, 50]),
        "sigma": st.tuples(*[st.floats(0.006, 9)] * 3),
        "dewarp": st.none()
        | st.tuples(*[st.floats(500, 9000)] * 2, *[st.floats(-40, 40)] * 2, *[st.floats(-0.5, 0.5)] * 5),
        "altitude_type": st.sampled_from(["", "RtkAlt", "GpsFusionAlt", "PressureAlt"]),
        "angles_in": st.sampled_from(["xmp", "makernote"]),
        "equivalent": st.integers(8, 200),
        "utc": st.datetimes(datetime(2010, 1, 1), datetime(2040, 1, 1), timezones=st.just(UTC)),
        "serial": st.text("0123456789ABCDEF", min_size=1, max_size=20),
        "elements": st.booleans(),
        "packet": st.sampled_from(["first", "second", "extension"]),
    }
)


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(RECORDS)
def test_random_true_records_come_back(tmp_path: Path, write_truth: Callable[..., Path], truth: dict) -> None:
    truth = truth | {
        name: round(truth[name], DIGITS) for name in ("latitude", "longitude", "height", "yaw", "pitch", "roll")
    }
    truth["sigma"] = tuple(round(value, DIGITS) for value in truth["sigma"])
    assume(truth["latitude"] or truth["longitude"])
    assume(truth["yaw"] or truth["pitch"] or truth["roll"])
    record = read_record(write_truth(tmp_path / "DJI_0001.JPG", truth))
    in_exif = truth["maker"] in ("parrot", "pix4d")
    tolerance = EXIF_DEGREES if in_exif else 0.0
    assert record.latitude == pytest.approx(truth["latitude"], abs=tolerance, rel=0)
    assert record.longitude == pytest.approx(truth["longitude"], abs=tolerance, rel=0)
    assert record.height == pytest.approx(truth["height"], abs=6e-4 if in_exif else 0.0, rel=0)
    assert record.position_source == ("exif" if in_exif else "xmp")
    stated = world_from_camera(truth["yaw"], truth["pitch"], truth["roll"])
    assert record.gimbal is not None
    # an angle of a hundred millionth of a turn, as 32-bit degrees and the change of convention leave it
    np.testing.assert_allclose(world_from_camera(*record.gimbal), stated, atol=2e-6)
    assert record.gimbal_source == (truth["angles_in"] if truth["maker"] == "dji" else "xmp")
    assert (record.focal_length_35mm, record.serial) == (truth["equivalent"], truth["serial"])
    _check_accuracy(record, truth)
    if truth["maker"] == "dji":
        assert record.utc == truth["utc"]
        _check_dewarp(record, truth["dewarp"])


def _check_accuracy(record: PhotoRecord, truth: dict) -> None:
    east, north, up = truth["sigma"]
    if truth["maker"] == "pix4d":
        assert record.position_sigma == pytest.approx((east, east, up))
    if truth["maker"] not in ("dji", "autel"):
        assert record.fix == "none"
        return
    flag, words = truth["flag"], truth["altitude_type"]
    fix = {0: "none", 16: "single", 32: "float", 34: "float", 49: "float", 50: "fixed"}[flag]
    assert (record.rtk_flag, record.fix, record.rtk_sigma) == (flag, fix, (east, north, up))
    least = {"fixed": 0.005, "float": 0.1, "single": 1.0, "none": 1.0}[fix]
    assert record.position_sigma == pytest.approx(tuple(max(least, sigma) for sigma in (east, north, up)))
    ellipsoidal = words == "RtkAlt" or (not words and flag > 0)
    assert record.altitude_kind == ("ellipsoidal" if ellipsoidal else "unknown")


def _check_dewarp(record: PhotoRecord, dewarp: tuple[float, ...] | None) -> None:
    assert (record.dewarp is None) == (dewarp is None)
    if record.dewarp is not None and dewarp is not None:
        expected = [round(value, DIGITS) for value in dewarp]
        found = record.dewarp
        assert [found.focal_x, found.focal_y, found.center_x, found.center_y, *found.distortion] == expected


@given(st.floats(-89, 89), st.floats(-179, 179), st.floats(-400, 8000))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_exif_alone(tmp_path: Path, exif_photograph: Callable[..., Path], latitude, longitude, altitude) -> None:
    record = read_record(exif_photograph(tmp_path / "a.jpg", latitude, longitude, altitude))
    if record.latitude is not None:
        assert record.latitude == pytest.approx(latitude, abs=EXIF_DEGREES)
        assert record.longitude == pytest.approx(longitude, abs=EXIF_DEGREES)
    assert record.height == pytest.approx(altitude, abs=5.1e-4)
    assert record.altitude_kind == "unknown"


def test_the_weight_follows_the_fix(photograph, drone_metadata, tmp_path: Path) -> None:
    def sigma(**changes: str) -> tuple[float, ...]:
        return read_record(photograph(tmp_path / "a.jpg", drone_metadata(1, 2, 3) | changes)).position_sigma

    assert sigma() == (0.01, 0.011, 0.02)
    assert min(sigma(RtkFlag="34")) >= 0.1, "a float solution isn't as good as its receiver believes"
    assert min(sigma(RtkFlag="16")) >= 1.0
    assert sigma(RtkStdLon="0.0") == sigma(RtkStdLon="nan") == (0.02, 0.02, 0.03)


@pytest.mark.parametrize("status", [{"GpsStatus": "Invalid"}, {"GpsLatitude": "0.0", "GpsLongitude": "0.0"}])
def test_no_fix_is_no_position(photograph, drone_metadata, tmp_path: Path, status: dict[str, str]) -> None:
    assert read_record(photograph(tmp_path / "a.jpg", drone_metadata(1, 2, 3) | status)).latitude is None


def test_impossible_values_are_refused(photograph, drone_metadata, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"latitude is 95"):
        read_record(photograph(tmp_path / "a.jpg", drone_metadata(95, 2, 3)))


def test_records_are_values(photograph, drone_metadata, tmp_path: Path) -> None:
    record = read_record(photograph(tmp_path / "a.jpg", drone_metadata(1, 2, 3)))
    assert PhotoRecord.model_validate_json(record.model_dump_json()) == record
    assert math.isclose(record.height, 3.0)
