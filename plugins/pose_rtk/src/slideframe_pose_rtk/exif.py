"""What a photograph's EXIF says: size, camera, and where the receiver was."""

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image

from slideframe.errors import InputError


@dataclass(frozen=True)
class Exif:
    """The tags that matter here; None where a tag is absent or isn't a number."""

    size: tuple[int, int]
    full_size: tuple[int, int] | None
    model: str
    latitude: float | None
    longitude: float | None
    height: float | None
    focal_length_35mm: float | None


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
    return Exif(
        size=size,
        full_size=_full_size(camera),
        model=str(tags.get(ExifTags.Base.Model, "")).strip("\x00 "),
        latitude=_angle(place, ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "S"),
        longitude=_angle(place, ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "W"),
        height=_height(place),
        focal_length_35mm=_positive(camera.get(ExifTags.Base.FocalLengthIn35mmFilm)),
    )


def _full_size(camera: dict[int, Any]) -> tuple[int, int] | None:
    width, height = (
        _positive(camera.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
    )
    return (int(width), int(height)) if width and height else None


def _angle(place: dict[int, Any], tag: int, reference_tag: int, negative: str) -> float | None:
    """Return degrees from the EXIF triple of degrees, minutes and seconds."""
    triple = place.get(tag)
    if not isinstance(triple, tuple) or len(triple) != 3:
        return None
    parts = [number for part in triple if (number := _number(part)) is not None]
    if len(parts) != 3:
        return None
    degrees = parts[0] + parts[1] / 60 + parts[2] / 3600
    return -degrees if str(place.get(reference_tag, "")).strip("\x00 ").upper() == negative else degrees


def _height(place: dict[int, Any]) -> float | None:
    """Return EXIF's altitude with its sign; references 1 and 3 (EXIF 3.0) stand for below the level."""
    height = _number(place.get(ExifTags.GPS.GPSAltitude))
    reference = place.get(ExifTags.GPS.GPSAltitudeRef, 0)
    code = int.from_bytes(reference[:1], "big") if isinstance(reference, bytes) else _number(reference)
    return -height if height is not None and code in (1, 3) else height


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
