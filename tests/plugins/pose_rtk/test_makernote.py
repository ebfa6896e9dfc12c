"""DJI's MakerNote: the real one, and one written by hand from its description."""

import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import ExifTags, Image

from slideframe_pose_rtk.makernote import gimbal_from_makernote
from slideframe_pose_rtk.reading import read_record

ASCII, FLOAT = 2, 11  # EXIF's types of values


def directory(yaw: float, pitch: float, roll: float) -> bytes:
    """Build the directory of older cameras: maker, and the camera's angles as 32-bit floats."""
    entries = [
        struct.pack("<HHI4s", 1, ASCII, 4, b"DJI\0"),
        struct.pack("<HHIf", 0x09, FLOAT, 1, pitch),
        struct.pack("<HHIf", 0x0A, FLOAT, 1, yaw),
        struct.pack("<HHIf", 0x0B, FLOAT, 1, roll),
    ]
    return struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0)


def photograph(path: Path, note: bytes, **arguments: bytes) -> Path:
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "DJI"
    exif[ExifTags.Base.Model] = "FC300S"
    exif.get_ifd(ExifTags.IFD.Exif).update({ExifTags.Base.MakerNote: note})
    Image.new("RGB", (8, 6)).save(path, "JPEG", exif=exif, **arguments)
    return path


def test_angles_that_stand_nowhere_else(tmp_path: Path) -> None:
    record = read_record(photograph(tmp_path / "a.jpg", directory(106.8, -89.9, 0.5)))
    assert record.gimbal == (106.8, -89.9, 0.5)
    assert record.gimbal_source == "makernote"


def test_angles_as_text(tmp_path: Path) -> None:
    note = b"[ae_dbg_info:\xff\x00][GimbalDegree(Y,P,R):-1271,10,0][FlightDegree(Y,P,R):-970,9,0]"
    record = read_record(photograph(tmp_path / "a.jpg", note))
    assert record.gimbal == (-127.1, 1.0, 0.0)


def test_xmp_comes_first_unless_it_holds_zeros(tmp_path: Path, packet_of: Callable[..., bytes]) -> None:
    note = directory(10.0, -60.0, 0.0)
    names = ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree")
    stated = packet_of(dict(zip(names, ("20.0", "-50.0", "0.0"), strict=True)))
    assert read_record(photograph(tmp_path / "a.jpg", note, xmp=stated)).gimbal == (20.0, -50.0, 0.0)
    zeros = packet_of(dict.fromkeys(names, "0.0"))
    assert read_record(photograph(tmp_path / "b.jpg", note, xmp=zeros)).gimbal == (10.0, -60.0, 0.0)
    assert read_record(photograph(tmp_path / "c.jpg", directory(0.0, 0.0, 0.0), xmp=zeros)).has_zero_gimbal


@pytest.mark.parametrize("note", [b"", b"\x00" * 40, b"[GimbalDegree(Y,P,R):a,b,c]", directory(1, 2, 3)[:20]])
def test_notes_without_angles(tmp_path: Path, note: bytes) -> None:
    assert read_record(photograph(tmp_path / "a.jpg", note)).gimbal is None


def test_real_notes(shared: Path) -> None:
    """The same file's XMP states the same angles."""
    samples = shared / "data" / "metadata_samples"
    for name, angles in (
        ("dji_phantom3_FC300S", (45.0, -89.9, 0.0)),
        ("dji_p4m_rtkflag50_fixed", (106.8, -90.0, 0.0)),
    ):
        path = samples / f"{name}.jpg"
        assert gimbal_from_makernote(path, b"present") == angles
        assert read_record(path).gimbal == angles
