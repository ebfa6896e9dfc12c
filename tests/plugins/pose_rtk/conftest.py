"""A writer of photographs with true EXIF and XMP, independent of the reader under test."""

import struct
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from PIL import ExifTags, Image, TiffImagePlugin

from slideframe.device import Device
from slideframe.stages import Context

DRONE_NAMESPACE = "http://www.dji.com/drone-dji/1.0/"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"


def xmp_packet(values: dict[str, str], *, elements: bool = False) -> bytes:
    """Build a packet with the values as attributes (cameras) or child elements (editing programs)."""
    attributes = "" if elements else "".join(f" d:{name}={quoteattr(value)}" for name, value in values.items())
    children = "".join(f"<d:{name}>{value}</d:{name}>" for name, value in values.items()) if elements else ""
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        f'<rdf:RDF xmlns:rdf="{RDF}">'
        f'<rdf:Description rdf:about="" xmlns:d="{DRONE_NAMESPACE}"{attributes}>{children}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta>   <?xpacket end="w"?>'
    ).encode()


def drone_values(
    latitude: float, longitude: float, height: float, yaw: float = 20.0, pitch: float = -60.0
) -> dict[str, str]:
    """Return what a drone with a fixed RTK position writes."""
    return {
        "AltitudeType": "RtkAlt",
        "GpsLatitude": f"{latitude:+.9f}",
        "GpsLongitude": f"{longitude:+.9f}",
        "AbsoluteAltitude": f"{height:+.3f}",
        "RelativeAltitude": "+50.000",
        "GimbalYawDegree": f"{yaw:+.2f}",
        "GimbalPitchDegree": f"{pitch:+.2f}",
        "GimbalRollDegree": "+0.00",
        "RtkFlag": "50",
        "RtkStdLon": "0.01000",
        "RtkStdLat": "0.01100",
        "RtkStdHgt": "0.02000",
    }


@pytest.fixture
def photograph() -> Callable[..., Path]:
    """Write a small photograph and return its path."""

    def write(
        path: Path,
        values: dict[str, str] | None = None,
        *,
        size: tuple[int, int] = (64, 48),
        exif_size: tuple[int, int] | None = None,
        packet: bytes | None = None,
        shade: int = 0,
        taken: str = "",
    ) -> Path:
        exif = Image.Exif()
        camera = {ExifTags.Base.FocalLengthIn35mmFilm: 24}
        if exif_size:
            camera |= {ExifTags.Base.ExifImageWidth: exif_size[0], ExifTags.Base.ExifImageHeight: exif_size[1]}
        if taken:
            camera[ExifTags.Base.DateTimeOriginal] = taken
        exif.get_ifd(ExifTags.IFD.Exif).update(camera)
        pixels = np.full((size[1], size[0], 3), shade, np.uint8)
        xmp = packet if packet is not None else xmp_packet(values or {})
        Image.fromarray(pixels).save(path, "JPEG", exif=exif, xmp=xmp)
        return path

    return write


@pytest.fixture
def context(tmp_path: Path) -> Context:
    """Surround a stage with a scratch folder of its own."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    return Context(device=Device(), scratch=scratch)


def exif_only(path: Path, latitude: float, longitude: float, altitude: float) -> Path:
    """Write a photograph whose position stands in EXIF alone, as older cameras do."""
    exif = Image.Exif()
    gps = ExifTags.GPS
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(
        {
            gps.GPSLatitudeRef: "N" if latitude >= 0 else "S",
            gps.GPSLatitude: _sexagesimal(abs(latitude)),
            gps.GPSLongitudeRef: "E" if longitude >= 0 else "W",
            gps.GPSLongitude: _sexagesimal(abs(longitude)),
            gps.GPSAltitudeRef: b"\x00" if altitude >= 0 else b"\x01",
            gps.GPSAltitude: TiffImagePlugin.IFDRational(round(abs(altitude) * 1000), 1000),
        }
    )
    Image.new("RGB", (64, 48)).save(path, "JPEG", exif=exif)
    return path


def _sexagesimal(angle: float) -> tuple[TiffImagePlugin.IFDRational, ...]:
    seconds = round(angle * 3600 * 10_000)
    rational = TiffImagePlugin.IFDRational
    return (
        rational(seconds // 36_000_000),
        rational(seconds // 600_000 % 60),
        rational(seconds % 600_000, 10_000),
    )


@pytest.fixture
def exif_photograph() -> Callable[..., Path]:
    """Write a photograph with EXIF alone."""
    return exif_only


@pytest.fixture
def packet_of() -> Callable[..., bytes]:
    """Build an XMP packet."""
    return xmp_packet


@pytest.fixture
def drone_metadata() -> Callable[..., dict[str, str]]:
    """Return a drone's XMP values."""
    return drone_values


MAKERS = {
    "dji": DRONE_NAMESPACE,
    "autel": "http://www.autelrobotics.com/drone-autel/1.0/",
    "parrot": "http://www.parrot.com/drone-parrot/1.0/",
    "skydio": "https://www.skydio.com/drone-skydio/1.0/",
    "pix4d": "http://pix4d.com/camera/1.0/",
}
NOTE_FLOAT = 11  # EXIF's type of a 32-bit float


@pytest.fixture
def write_truth() -> Callable[..., Path]:
    """Write a true record as one maker would, and return the photograph's path; see RECORDS in test_reading."""
    return _write_truth


def _write_truth(path: Path, truth: dict) -> Path:
    maker = truth["maker"]
    values = {"dji": _dji, "autel": _dji, "parrot": _parrot, "skydio": _skydio, "pix4d": _pix4d}[maker](truth)
    packet = _packet(values, MAKERS[maker], elements=truth["elements"])
    exif = Image.Exif()
    base, gps = ExifTags.Base, ExifTags.GPS
    exif[base.Make] = {"dji": "DJI", "autel": "Autel Robotics", "parrot": "Parrot", "skydio": "Skydio"}.get(maker, "X")
    camera = {base.FocalLengthIn35mmFilm: truth["equivalent"], base.BodySerialNumber: truth["serial"]}
    if maker == "dji" and truth["angles_in"] == "makernote":
        camera[base.MakerNote] = _note(truth["yaw"], truth["pitch"], truth["roll"])
    exif.get_ifd(ExifTags.IFD.Exif).update(camera)
    if maker in ("parrot", "pix4d"):
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(
            {
                gps.GPSLatitudeRef: "N" if truth["latitude"] >= 0 else "S",
                gps.GPSLatitude: _sexagesimal(abs(truth["latitude"])),
                gps.GPSLongitudeRef: "E" if truth["longitude"] >= 0 else "W",
                gps.GPSLongitude: _sexagesimal(abs(truth["longitude"])),
                gps.GPSAltitudeRef: b"\x00" if truth["height"] >= 0 else b"\x01",
                gps.GPSAltitude: TiffImagePlugin.IFDRational(round(abs(truth["height"]) * 1000), 1000),
            }
        )
    Image.new("RGB", (64, 48)).save(path, "JPEG", exif=exif, **({"xmp": packet} if truth["packet"] == "first" else {}))
    if truth["packet"] != "first":
        _insert(path, packet, extended=truth["packet"] == "extension")
    return path


def _dji(truth: dict) -> dict[str, str]:
    latitude = truth["spelling"].replace("Longt", "Lat").replace("Long", "Lat")
    values = {
        latitude: f"{truth['latitude']:+.6f}",
        truth["spelling"]: f"{truth['longitude']:+.6f}",
        "AbsoluteAltitude": f"{truth['height']:+.6f}",
        "RtkFlag": str(truth["flag"]),
        **dict(zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), (f"{value:.6f}" for value in truth["sigma"]), strict=True)),
        "UTCAtExposure": f"{truth['utc']:%Y-%m-%dT%H:%M:%S.%f}",
    }
    if truth["altitude_type"]:
        values["AltitudeType"] = truth["altitude_type"]
    if truth["dewarp"]:
        values["DewarpData"] = " 2024-02-29;" + ",".join(f"{value:.6f}" for value in truth["dewarp"])
    if truth["maker"] == "autel" or truth["angles_in"] == "xmp":
        values |= {f"Gimbal{axis.title()}Degree": f"{truth[axis]:+.6f}" for axis in ("yaw", "pitch", "roll")}
    return values


def _parrot(truth: dict) -> dict[str, str]:
    return {f"Camera{axis.title()}Degree": f"{truth[axis]:.6f}" for axis in ("yaw", "pitch", "roll")}


def _skydio(truth: dict) -> dict[str, object]:
    return {
        "Latitude": f"{truth['latitude']:.6f}",
        "Longitude": f"{truth['longitude']:.6f}",
        "AbsoluteAltitude": f"{truth['height']:.6f}",
        "CameraOrientationNED": {axis.title(): f"{truth[axis]:.6f}" for axis in ("yaw", "pitch", "roll")},
    }


def _pix4d(truth: dict) -> dict[str, str]:
    """Pix4D's angles of the same orientation: R = Rz Ry Rx of a camera that looks down at zero, by SciPy."""
    from scipy.spatial.transform import Rotation

    camera = Rotation.from_euler("ZYX", [truth["yaw"], truth["pitch"], truth["roll"]], degrees=True)
    yaw, pitch, roll = (camera * Rotation.from_euler("Y", 90, degrees=True)).as_euler("ZYX", degrees=True)
    east, _, up = truth["sigma"]
    return {
        "Yaw": f"{yaw:.9f}",
        "Pitch": f"{pitch:.9f}",
        "Roll": f"{roll:.9f}",
        "GPSXYAccuracy": f"{round(east * 1_000_000)}/1000000",
        "GPSZAccuracy": f"{round(up * 1_000_000)}/1000000",
    }


def _packet(values: dict, namespace: str, *, elements: bool) -> bytes:
    structures = "".join(
        f'<d:{name} rdf:parseType="Resource">{"".join(f"<d:{n}>{v}</d:{n}>" for n, v in value.items())}</d:{name}>'
        if elements
        else f"<d:{name}{''.join(f' d:{n}={quoteattr(v)}' for n, v in value.items())}/>"
        for name, value in values.items()
        if isinstance(value, dict)
    )
    plain = {name: value for name, value in values.items() if isinstance(value, str)}
    attributes = "" if elements else "".join(f" d:{name}={quoteattr(value)}" for name, value in plain.items())
    children = "".join(f"<d:{name}>{value}</d:{name}>" for name, value in plain.items()) if elements else ""
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="{RDF}"><rdf:Description rdf:about=""'
        f' xmlns:d="{namespace}"{attributes}>{children}{structures}</rdf:Description></rdf:RDF></x:xmpmeta>'
    ).encode()


def _note(yaw: float, pitch: float, roll: float) -> bytes:
    """Build DJI's MakerNote of older cameras: a directory with the camera's angles."""
    entries = [struct.pack("<HHI4s", 1, 2, 4, b"DJI\0")]
    entries += [struct.pack("<HHIf", tag, NOTE_FLOAT, 1, angle) for tag, angle in ((9, pitch), (10, yaw), (11, roll))]
    return struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0)


def _insert(path: Path, packet: bytes, *, extended: bool) -> None:
    """Put a packet behind an empty standard one, in a second one or as two parts of an extension."""
    standard = b"http://ns.adobe.com/xap/1.0/\x00"
    bodies = [standard + _packet({}, DRONE_NAMESPACE, elements=False)]
    if extended:
        guid, half = b"0123456789ABCDEF" * 2, len(packet) // 2
        for start, part in ((half, packet[half:]), (0, packet[:half])):
            head = b"http://ns.adobe.com/xmp/extension/\x00" + guid + struct.pack(">II", len(packet), start)
            bodies.append(head + part)
    else:
        bodies.append(standard + packet)
    data = path.read_bytes()
    segments = b"".join(b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body for body in bodies)
    path.write_bytes(data[:2] + segments + data[2:])
