"""DJI's time marks (.MRK): one line per exposure, with the receiver's time, position and lever arm."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slideframe.errors import InputError
from slideframe_pose_rtk.metadata import PhotoRecord, Triple

SUFFIX = ".mrk"
NUMBER = r"(-?\d+(?:\.\d+)?)"
# `1  400373.488877  [2264]  -40,N  0,E  86,V  44.42824637,Lat  1.26196331,Lon  359.494,Ellh  0.028, 0.031, 0.055  16,Q`
HEAD = re.compile(rf"^\s*(\d+)\s+{NUMBER}\s+(?:\[(\d+)\])?")
LABELS = ("N", "E", "V", "Lat", "Lon", "Ellh", "Q")
SIGMA = re.compile(rf"Ellh\s+{NUMBER}\s*,\s*{NUMBER}\s*,\s*{NUMBER}")
# DJI_0012.JPG, DJI_20241107101229_0012_V.JPG, 100_0004_0012.JPG
PHOTOGRAPH_NUMBER = re.compile(r"_(\d{3,5})(?:_[A-Za-z]\w*)?$")
MILLIMETERS = 1000.0


@dataclass(frozen=True)
class Mark:
    """One exposure.

    Attributes:
        number: of the photograph within the flight.
        time: GPS seconds of week.
        week: GPS week; None where the file leaves it out.
        lever_arm: from the antenna to the camera, m north, east, down.
        latitude: of the camera, degrees: the real-time position with the lever arm applied.
        longitude: degrees.
        height: ellipsoidal, m.
        sigma: m east, north, up.
        flag: quality, as RtkFlag.
    """

    number: int
    time: float
    week: int | None
    lever_arm: Triple
    latitude: float
    longitude: float
    height: float
    sigma: Triple
    flag: int


def read_marks(path: Path) -> dict[int, Mark]:
    """Return the marks of a file by number (DJI Matrice 4 user manual, "Image Log File").

    Raises:
        InputError: a line can't be read.
    """
    marks = {}
    for row, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        if not line.strip("\x00 \t"):
            continue
        mark = _mark(line)
        if mark is None:
            raise InputError(
                f"line {row} is no time mark: {line[:60]!r}",
                where=str(path),
                cure="copy the file from the drone again, or move it away, or set position_files = false",
            )
        marks[mark.number] = mark
    return marks


def photograph_number(record: PhotoRecord) -> int | None:
    """Return the number that the drone gave the photograph in its name."""
    found = PHOTOGRAPH_NUMBER.search(record.path.stem)
    return int(found[1]) if found else None


def mark_files(photographs: Sequence[Path]) -> list[Path]:
    """Return the .MRK files beside the photographs."""
    folders = sorted({path.parent for path in photographs})
    return sorted(path for folder in folders for path in folder.iterdir() if path.suffix.lower() == SUFFIX)


def _mark(line: str) -> Mark | None:
    head, sigma = HEAD.match(line), SIGMA.search(line)
    found = {label: re.search(rf"{NUMBER}\s*,\s*{label}\b", line) for label in LABELS}
    if head is None or sigma is None or None in found.values():
        return None
    value = {label: float(match[1]) for label, match in found.items() if match}
    north, east, up = (float(number) for number in sigma.groups())
    return Mark(
        number=int(head[1]),
        time=float(head[2]),
        week=int(head[3]) if head[3] else None,
        lever_arm=(value["N"] / MILLIMETERS, value["E"] / MILLIMETERS, value["V"] / MILLIMETERS),
        latitude=value["Lat"],
        longitude=value["Lon"],
        height=value["Ellh"],
        sigma=(east, north, up),
        flag=int(value["Q"]),
    )
