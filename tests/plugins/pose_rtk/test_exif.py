from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from slideframe_pose_rtk.exif import Exif, read_exif

BASE, GPS = ExifTags.Base, ExifTags.GPS


def read(path: Path, main: dict | None = None, camera: dict | None = None, place: dict | None = None) -> Exif:
    exif = Image.Exif()
    exif.update(main or {})
    exif.get_ifd(ExifTags.IFD.Exif).update(camera or {})
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(place or {})
    Image.new("RGB", (8, 6)).save(path, "JPEG", exif=exif)
    return read_exif(path)


def test_the_camera(tmp_path: Path) -> None:
    exif = read(
        tmp_path / "a.jpg",
        {BASE.Make: "DJI\x00", BASE.Model: " M3E ", BASE.Orientation: 3},
        {
            BASE.BodySerialNumber: "1581F5",
            BASE.FocalLength: IFDRational(1229, 100),
            BASE.ExposureTime: IFDRational(1, 500),
        },
    )
    assert (exif.make, exif.model, exif.serial, exif.orientation) == ("DJI", "M3E", "1581F5", 3)
    assert (exif.focal_length, exif.exposure_time) == (12.29, 0.002)
    assert (exif.size, exif.full_size, exif.maker_note) == ((8, 6), None, b"")


@pytest.mark.parametrize(("unit", "pitch"), [(2, 25.4 / 5000), (3, 10 / 5000), (4, 1 / 5000), (5, 1e-3 / 5000)])
def test_pixel_pitch_in_every_unit(tmp_path: Path, unit: int, pitch: float) -> None:
    camera = {BASE.FocalPlaneXResolution: IFDRational(5000), BASE.FocalPlaneResolutionUnit: unit}
    assert read(tmp_path / "a.jpg", camera=camera).pixel_pitch == pytest.approx(pitch)


@pytest.mark.parametrize(
    ("code", "height", "reference"),
    [
        (b"\x00", 12.5, "sea level"),
        (b"\x01", -12.5, "sea level"),
        (b"\x02", 12.5, "ellipsoid"),
        (b"\x03", -12.5, "ellipsoid"),
        (None, 12.5, None),
    ],
)
def test_altitude_references(tmp_path: Path, code: bytes | None, height: float, reference: str | None) -> None:
    place = {GPS.GPSAltitude: IFDRational(125, 10)} | ({} if code is None else {GPS.GPSAltitudeRef: code})
    exif = read(tmp_path / "a.jpg", place=place)
    assert (exif.height, exif.altitude_reference) == (height, reference)


def test_time_with_and_without_a_zone(tmp_path: Path) -> None:
    camera: dict[int, Any] = {BASE.DateTimeOriginal: "2024:11:07 10:12:05", BASE.SubsecTimeOriginal: "48"}
    local = read(tmp_path / "a.jpg", camera=camera)
    assert local.local_time == datetime(2024, 11, 7, 10, 12, 5, 480_000)
    assert local.utc is None
    zoned = read(tmp_path / "b.jpg", camera=camera | {BASE.OffsetTimeOriginal: "+08:00"})
    assert zoned.utc == datetime(2024, 11, 7, 2, 12, 5, 480_000, tzinfo=UTC)
    place = {GPS.GPSDateStamp: "2024:11:07", GPS.GPSTimeStamp: (IFDRational(2), IFDRational(12), IFDRational(65, 10))}
    assert read(tmp_path / "c.jpg", camera=camera, place=place).utc == datetime(
        2024, 11, 7, 2, 12, 6, 500_000, tzinfo=UTC
    )


@pytest.mark.parametrize(
    "camera",
    [
        {BASE.DateTimeOriginal: "0000:00:00 00:00:00"},
        {BASE.DateTimeOriginal: "yesterday"},
        {BASE.ExposureTime: IFDRational(0, 0)},
    ],
)
def test_nonsense_is_as_good_as_absent(tmp_path: Path, camera: dict) -> None:
    exif = read(tmp_path / "a.jpg", camera=camera, place={GPS.GPSLatitude: (IFDRational(1), IFDRational(0, 0))})
    assert (exif.local_time, exif.exposure_time, exif.latitude) == (None, None, None)
