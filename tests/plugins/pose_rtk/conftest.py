"""A writer of photographs with true EXIF and XMP, independent of the reader under test."""

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
    ) -> Path:
        exif = Image.Exif()
        camera = {ExifTags.Base.FocalLengthIn35mmFilm: 24}
        if exif_size:
            camera |= {ExifTags.Base.ExifImageWidth: exif_size[0], ExifTags.Base.ExifImageHeight: exif_size[1]}
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
