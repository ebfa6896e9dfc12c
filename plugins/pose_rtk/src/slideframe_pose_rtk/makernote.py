"""Gimbal angles from DJI's MakerNote, for cameras that write them nowhere else."""

import re
from pathlib import Path

# Older cameras: an EXIF directory with these floats. Names as exifread gives them.
DIRECTORY_TAGS = ("MakerNote CameraYaw", "MakerNote CameraPitch", "MakerNote CameraRoll")
# Mavic 2 and its generation: text, in tenths of a degree, such as [GimbalDegree(Y,P,R):-1271,10,0].
TEXT = re.compile(rb"\[GimbalDegree\(Y,P,R\):\s*(-?\d+),(-?\d+),(-?\d+)")
TENTHS = 10.0
# The directory's floats carry 32 bits, and DJI states tenths of a degree.
DIGITS = 4


def gimbal_from_makernote(path: Path, note: bytes) -> tuple[float, float, float] | None:
    """Return yaw, pitch, roll in degrees, or None where the MakerNote has none.

    Args:
        path: the photograph.
        note: EXIF's MakerNote, undecoded.
    """
    text = TEXT.search(note)
    if text:
        yaw, pitch, roll = (int(tenths) / TENTHS for tenths in text.groups())
        return yaw, pitch, roll
    return _from_directory(path) if note else None


def _from_directory(path: Path) -> tuple[float, float, float] | None:
    import exifread

    with path.open("rb") as file:
        tags = exifread.process_file(file, details=True)
    angles = [_first(tags[name]) for name in DIRECTORY_TAGS if name in tags]
    if len(angles) != len(DIRECTORY_TAGS) or None in angles:
        return None
    yaw, pitch, roll = (round(angle, DIGITS) for angle in angles if angle is not None)
    return yaw, pitch, roll


def _first(tag: object) -> float | None:
    values = getattr(tag, "values", None)
    while isinstance(values, list | tuple) and values:
        values = values[0]
    return float(values) if isinstance(values, int | float) else None
