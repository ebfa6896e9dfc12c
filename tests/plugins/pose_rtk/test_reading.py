import csv
import json
import math
import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slideframe.errors import InputError
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.reading import read_record
from slideframe_pose_rtk.xmp import EXTENSION, xmp_packets

PRINTED_DEGREES = 5e-10  # the expected values are printed to nine decimals
EXIF_DEGREES = 2e-8  # EXIF's ten thousandth of a second
XMP_DEGREES = 1e-7  # older cameras write seven decimals

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


@pytest.mark.skipif(not shutil.which("exiftool"), reason="exiftool isn't installed")
def test_agrees_with_exiftool(shared: Path) -> None:
    files = sorted((shared / "data" / "metadata_samples").glob("*.jpg"))
    tags = ["-GPSLatitude", "-GPSLongitude", "-AbsoluteAltitude", "-FocalLengthIn35mmFormat", "-GimbalYawDegree"]
    told = json.loads(subprocess.run(["exiftool", "-j", "-n", *tags, *files], capture_output=True, check=True).stdout)
    for path, tag in zip(files, told, strict=True):
        record = read_record(path)
        # exiftool's composite position is EXIF's, ours XMP's where there is one
        assert record.latitude == pytest.approx(tag["GPSLatitude"], abs=XMP_DEGREES)
        assert record.longitude == pytest.approx(tag["GPSLongitude"], abs=XMP_DEGREES)
        assert record.focal_length_35mm == tag.get("FocalLengthIn35mmFormat")
        if "AbsoluteAltitude" in tag:
            assert record.height == float(tag["AbsoluteAltitude"])
        if "GimbalYawDegree" in tag:
            assert record.gimbal[0] == float(tag["GimbalYawDegree"])


def test_a_whole_flight_to_the_printed_digits(shared: Path) -> None:
    from slideframe_pose_rtk.geodesy import LocalFrame, mean_origin
    from slideframe_pose_rtk.orientation import world_from_camera

    flight = shared / "data" / "uav" / "mirafiori_rtk"
    rows = list(csv.DictReader((flight / "reference" / "metadata_expected.csv").read_text().splitlines()))
    records = [read_record(flight / "images" / row["name"]) for row in rows]
    places = np.array([(record.latitude, record.longitude, record.height) for record in records]).T
    local = LocalFrame(mean_origin(*places)).to_local(*places)
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


WRITTEN_DIGITS = 6


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    latitude=st.floats(-90, 90),
    longitude=st.floats(-180, 180),
    height=st.floats(-500, 9000),
    gimbal=st.tuples(*[st.floats(-180, 180)] * 3),
    flag=st.sampled_from([0, 16, 34, 49, 50]),
    sigma=st.tuples(*[st.floats(0.006, 9)] * 3),
    dewarp=st.tuples(*[st.floats(500, 9000)] * 2, *[st.floats(-40, 40)] * 2, *[st.floats(-0.5, 0.5)] * 5),
    longitude_name=st.sampled_from(["GpsLongitude", "GpsLongtitude", "GPSLongitude", "Longitude"]),
    elements=st.booleans(),
)
def test_random_records_round_trip(
    tmp_path: Path,
    photograph: Callable[..., Path],
    packet_of: Callable[..., bytes],
    latitude,
    longitude,
    height,
    gimbal,
    flag,
    sigma,
    dewarp,
    longitude_name,
    elements,
) -> None:
    values = {longitude_name.replace("Longtitude", "Latitude").replace("Longitude", "Latitude"): latitude}
    values |= {longitude_name: longitude, "AbsoluteAltitude": height, "RtkFlag": flag}
    values |= dict(zip(("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), gimbal, strict=True))
    values |= dict(zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), sigma, strict=True))
    text = {name: f"{value:+.{WRITTEN_DIGITS}f}" for name, value in values.items()}
    text["DewarpData"] = " 2024-02-29;" + ",".join(f"{value:.{WRITTEN_DIGITS}f}" for value in dewarp)
    record = read_record(photograph(tmp_path / "a.jpg", packet=packet_of(text, elements=elements)))
    if round(latitude, WRITTEN_DIGITS) == round(longitude, WRITTEN_DIGITS) == 0:
        assert record.latitude is None  # no fix
    else:
        assert (record.latitude, record.longitude) == (round(latitude, 6), round(longitude, 6))
    assert record.height == round(height, 6)
    assert record.gimbal == tuple(round(angle, 6) for angle in gimbal)
    assert record.rtk_sigma == tuple(round(value, 6) for value in sigma)
    assert record.fix == {0: "none", 16: "single", 34: "float", 49: "float", 50: "fixed"}[flag]
    assert record.altitude_kind == ("ellipsoidal" if flag else "unknown")
    assert (record.dewarp.focal_x, record.dewarp.center_y) == (round(dewarp[0], 6), round(dewarp[3], 6))
    assert record.dewarp.distortion == tuple(round(value, 6) for value in dewarp[4:])


@given(st.floats(-89, 89), st.floats(-179, 179), st.floats(-400, 8000))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
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


def test_extended_packets_are_assembled(photograph, packet_of, tmp_path: Path) -> None:
    path = photograph(tmp_path / "a.jpg", {"RtkFlag": "50"})
    extension = packet_of({"GimbalYawDegree": "+12.5", "RtkFlag": "16"})
    parts = b""
    for start in (400, 0):  # in any order
        payload = extension[start : 400 if start == 0 else None]
        body = EXTENSION + b"0" * 32 + struct.pack(">II", len(extension), start) + payload
        parts += b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body
    data = path.read_bytes()
    path.write_bytes(data[:2] + parts + data[2:])
    assert xmp_packets(path)[1] == extension
    assert read_record(path).rtk_flag == 50, "the standard packet counts first"


@pytest.mark.parametrize("status", [{"GpsStatus": "Invalid"}, {"GpsLatitude": "0.0", "GpsLongitude": "0.0"}])
def test_no_fix_is_no_position(photograph, drone_metadata, tmp_path: Path, status: dict[str, str]) -> None:
    assert read_record(photograph(tmp_path / "a.jpg", drone_metadata(1, 2, 3) | status)).latitude is None


BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/">&b;</x:xmpmeta>'
)


@pytest.mark.parametrize(("packet", "what"), [(BOMB, "document type or entities"), (b"<x:xmpmeta", "isn't valid XML")])
def test_hostile_xmp_is_refused_by_name(photograph, tmp_path: Path, packet: bytes, what: str) -> None:
    path = photograph(tmp_path / "evil.jpg", packet=packet)
    with pytest.raises(InputError, match=what) as caught:
        read_record(path)
    assert "evil.jpg" in str(caught.value)


def test_impossible_values_are_refused(photograph, drone_metadata, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"latitude is 95"):
        read_record(photograph(tmp_path / "a.jpg", drone_metadata(95, 2, 3)))


def test_records_are_values(photograph, drone_metadata, tmp_path: Path) -> None:
    record = read_record(photograph(tmp_path / "a.jpg", drone_metadata(1, 2, 3)))
    assert PhotoRecord.model_validate_json(record.model_dump_json()) == record
    assert math.isclose(record.height, 3.0)
