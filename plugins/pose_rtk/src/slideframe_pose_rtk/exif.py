"""What a photograph's EXIF says: size, camera, time, and where the receiver was (CIPA DC-008, EXIF 3.0)."""

import math
import struct
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from PIL import ExifTags, Image

from slideframe.errors import InputError

Tags = dict[int, Any]
AltitudeReference = Literal["sea level", "ellipsoid"]

# GPSAltitudeRef; EXIF 3.0 added the last two
ALTITUDE_REFERENCES: dict[int, AltitudeReference] = {0: "sea level", 1: "sea level", 2: "ellipsoid", 3: "ellipsoid"}
BELOW = (1, 3)
# FocalPlaneResolutionUnit in mm
RESOLUTION_UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}


@dataclass(frozen=True)
class Exif:
    """The tags that matter here; None or empty where a tag is absent or can't be read.

    Attributes:
        size: of the stored picture, px.
        full_size: as the camera wrote it, px; it stays when a picture is resized.
        orientation: 1 upright, 3 upside down, 6 and 8 on a side: how a viewer is to turn the stored pixels.
        latitude: degrees north, in `map_datum`.
        longitude: degrees east.
        height: m above `altitude_reference`.
        map_datum: usually WGS-84, or empty.
        focal_length: mm.
        focal_length_35mm: equivalent, mm.
        pixel_pitch: distance of pixels of the full-size picture on the sensor, mm.
        utc: time of the exposure where EXIF tells the time zone or GPS time.
        local_time: as the camera's clock showed it.
        exposure_time: s.
    """

    size: tuple[int, int]
    full_size: tuple[int, int] | None
    orientation: int
    make: str
    model: str
    serial: str
    latitude: float | None
    longitude: float | None
    height: float | None
    altitude_reference: AltitudeReference | None
    map_datum: str
    focal_length: float | None
    focal_length_35mm: float | None
    pixel_pitch: float | None
    utc: datetime | None
    local_time: datetime | None
    exposure_time: float | None
    maker_note: bytes


def read_exif(path: Path) -> Exif:
    """Read size and EXIF of a picture without decoding it.

    Raises:
        InputError: the file isn't a picture that Pillow knows, or its header is damaged.
    """
    try:
        with Image.open(path) as picture:
            size, tags = picture.size, picture.getexif()
            camera = tags.get_ifd(ExifTags.IFD.Exif)
            place = tags.get_ifd(ExifTags.IFD.GPSInfo)
    except (OSError, SyntaxError, ValueError, struct.error, Image.DecompressionBombError) as error:
        raise InputError(
            "it isn't a readable picture", where=str(path), cure="copy it from the drone again, or remove it"
        ) from error
    height, reference = _altitude(place)
    local_time = _time(camera.get(ExifTags.Base.DateTimeOriginal), camera.get(ExifTags.Base.SubsecTimeOriginal))
    note = camera.get(ExifTags.Base.MakerNote)
    return Exif(
        size=size,
        full_size=_full_size(camera),
        orientation=int(_number(tags.get(ExifTags.Base.Orientation)) or 1),
        make=_text(tags.get(ExifTags.Base.Make)),
        model=_text(tags.get(ExifTags.Base.Model)),
        serial=_text(camera.get(ExifTags.Base.BodySerialNumber) or tags.get(ExifTags.Base.CameraSerialNumber)),
        latitude=_angle(place, ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "S"),
        longitude=_angle(place, ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "W"),
        height=height,
        altitude_reference=reference,
        map_datum=_text(place.get(ExifTags.GPS.GPSMapDatum)),
        focal_length=_positive(camera.get(ExifTags.Base.FocalLength)),
        focal_length_35mm=_positive(camera.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        pixel_pitch=_pixel_pitch(camera),
        utc=_gps_time(place) or _zoned(local_time, camera.get(ExifTags.Base.OffsetTimeOriginal)),
        local_time=local_time,
        exposure_time=_positive(camera.get(ExifTags.Base.ExposureTime)),
        maker_note=note if isinstance(note, bytes) else b"",
    )


def _full_size(camera: Tags) -> tuple[int, int] | None:
    width, height = (
        _positive(camera.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
    )
    return (int(width), int(height)) if width and height else None


def _angle(place: Tags, tag: int, reference_tag: int, negative: str) -> float | None:
    """Return degrees from the EXIF triple of degrees, minutes and seconds."""
    triple = place.get(tag)
    if not isinstance(triple, tuple) or len(triple) != 3:
        return None
    parts = [number for part in triple if (number := _number(part)) is not None]
    if len(parts) != 3:
        return None
    degrees = parts[0] + parts[1] / 60 + parts[2] / 3600
    return -degrees if _text(place.get(reference_tag)).upper() == negative else degrees


def _altitude(place: Tags) -> tuple[float | None, AltitudeReference | None]:
    """Return the altitude with its sign, and what it's measured from."""
    height = _number(place.get(ExifTags.GPS.GPSAltitude))
    stated = place.get(ExifTags.GPS.GPSAltitudeRef)
    code = int.from_bytes(stated[:1], "big") if isinstance(stated, bytes) else _number(stated)
    reference = None if code is None else ALTITUDE_REFERENCES.get(int(code))
    return (-height if height is not None and code in BELOW else height), reference


def _pixel_pitch(camera: Tags) -> float | None:
    resolution = _positive(camera.get(ExifTags.Base.FocalPlaneXResolution))
    unit = RESOLUTION_UNITS.get(int(_number(camera.get(ExifTags.Base.FocalPlaneResolutionUnit)) or 2))
    return unit / resolution if unit and resolution else None


def _gps_time(place: Tags) -> datetime | None:
    """Return GPSDateStamp and GPSTimeStamp, which are UTC."""
    date, clock = _text(place.get(ExifTags.GPS.GPSDateStamp)), place.get(ExifTags.GPS.GPSTimeStamp)
    if not isinstance(clock, tuple) or len(clock) != 3:
        return None
    hours, minutes, seconds = (_number(part) for part in clock)
    try:
        day = datetime.strptime(date.replace("-", ":"), "%Y:%m:%d").replace(tzinfo=UTC)
        return day + timedelta(hours=hours or 0, minutes=minutes or 0, seconds=seconds or 0)
    except (ValueError, OverflowError):
        return None


def _time(stamp: Any, fraction: Any) -> datetime | None:
    digits = _text(fraction)
    try:
        whole = datetime.strptime(_text(stamp), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    return whole + timedelta(seconds=float(f"0.{digits}")) if digits.isdecimal() else whole


def _zoned(local_time: datetime | None, offset: Any) -> datetime | None:
    """Return UTC of a local time with EXIF's offset, such as `+08:00`."""
    if local_time is None:
        return None
    try:
        zone = datetime.strptime(_text(offset), "%z").tzinfo
    except ValueError:
        return None
    return local_time.replace(tzinfo=zone).astimezone(UTC)


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("ascii", "replace")
    return str(value).split("\x00")[0].strip() if value is not None else ""


def _positive(value: Any) -> float | None:
    number = _number(value)
    return number if number is not None and number > 0 else None


def _number(value: Any) -> float | None:
    """Read a rational or integer tag; cameras write 0/0 for unknown."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None
