"""The user's table of positions: a CSV file with a line per photograph."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from slideframe.errors import InputError
from slideframe_pose_rtk.metadata import AltitudeKind, Fix, Triple

NAME = ("name", "file", "image", "label")
# Either pair, and either height; the height's column says what it is measured from.
PLACES = (("latitude", "longitude"), ("easting", "northing"), ("x", "y"))
HEIGHTS: dict[str, AltitudeKind] = {"ellipsoidal_height": "ellipsoidal", "orthometric_height": "orthometric"}
SIGMA = ("sigma_east", "sigma_north", "sigma_up")
ANGLES = ("yaw", "pitch", "roll")
FIX = "fix"
KNOWN = {*NAME, *(name for pair in PLACES for name in pair), *HEIGHTS, *SIGMA, *ANGLES, FIX}
CURE = "give the columns that docs/survey.md names; heights are called ellipsoidal_height or orthometric_height"


@dataclass(frozen=True)
class TablePosition:
    """One line.

    Attributes:
        name: file name, or path below the folder of photographs.
        line: in the file, for messages.
        x: easting, or longitude in degrees.
        y: northing, or latitude in degrees.
        height: m.
        altitude_kind: ellipsoidal or orthometric.
        sigma: m east, north, up; None where the table has none.
        fix: None where the table has none.
        gimbal: yaw, pitch, roll in degrees; None where the table has none.
    """

    name: str
    line: int
    x: float
    y: float
    height: float
    altitude_kind: AltitudeKind
    sigma: Triple | None
    fix: Fix | None
    gimbal: Triple | None


@dataclass(frozen=True)
class Table:
    """All lines, and whether their places are degrees."""

    path: Path
    geographic: bool
    positions: tuple[TablePosition, ...]


def read_table(path: Path) -> Table:
    """Read a table of positions.

    Raises:
        InputError: a column is missing or unknown, a value is no number, or a name stands twice.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the table of positions can't be read: {error}", where=str(path), cure=CURE) from error
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not numbered:
        raise InputError("the table of positions is empty", where=str(path), cure=CURE)
    delimiter = max(",;\t", key=numbered[0][1].count)
    header = [column.strip().lower() for column in next(csv.reader([numbered[0][1]], delimiter=delimiter))]
    columns = _columns(header, path)
    rows = csv.reader([line for _, line in numbered[1:]], delimiter=delimiter, strict=True)
    try:
        positions = [_position(row, columns, number, path) for row, (number, _) in zip(rows, numbered[1:], strict=True)]
    except (csv.Error, ValueError) as error:
        raise InputError(f"the table of positions can't be read: {error}", where=str(path), cure=CURE) from error
    _require_distinct(positions, path)
    return Table(path, columns.geographic, tuple(positions))


@dataclass(frozen=True)
class _Columns:
    name: int
    place: tuple[int, int]
    height: int
    altitude_kind: AltitudeKind
    sigma: tuple[int, ...]
    angles: tuple[int, ...]
    fix: int | None
    geographic: bool


def _columns(header: list[str], path: Path) -> _Columns:
    unknown = [column for column in header if column and column not in KNOWN]
    if unknown:
        raise InputError(
            f"the table of positions has columns of unknown meaning: {', '.join(unknown)}", where=str(path), cure=CURE
        )
    if len(set(header)) < len(header):
        raise InputError("two columns of the table of positions have one name", where=str(path), cure=CURE)
    names = [column for column in NAME if column in header]
    places = [pair for pair in PLACES if all(column in header for column in pair)]
    heights = [column for column in HEIGHTS if column in header]
    for found, what in ((names, NAME), (places, PLACES), (heights, tuple(HEIGHTS))):
        if len(found) != 1:
            wanted = " or ".join(" with ".join(one) if isinstance(one, tuple) else one for one in what)
            raise InputError(f"the table of positions needs exactly one of {wanted}", where=str(path), cure=CURE)
    x, y = (header.index(column) for column in places[0])
    geographic = places[0] == PLACES[0]
    return _Columns(
        name=header.index(names[0]),
        place=(y, x) if geographic else (x, y),  # latitude is y
        height=header.index(heights[0]),
        altitude_kind=HEIGHTS[heights[0]],
        sigma=_all_or_none(header, SIGMA, path),
        angles=_all_or_none(header, ANGLES, path),
        fix=header.index(FIX) if FIX in header else None,
        geographic=geographic,
    )


def _all_or_none(header: list[str], columns: Sequence[str], path: Path) -> tuple[int, ...]:
    found = tuple(header.index(column) for column in columns if column in header)
    if found and len(found) < len(columns):
        raise InputError(f"of {', '.join(columns)} the table of positions has only some", where=str(path), cure=CURE)
    return found


def _position(row: list[str], columns: _Columns, line: int, path: Path) -> TablePosition:
    def number(column: int) -> float:
        try:
            value = float(row[column])
        except (IndexError, ValueError) as error:
            raise ValueError(f"line {line} has no number in column {column + 1}") from error
        if not math.isfinite(value):
            raise ValueError(f"line {line} has {value} in column {column + 1}")
        return value

    def triple(places: tuple[int, ...]) -> Triple | None:
        if not places or not any(row[place].strip() for place in places if place < len(row)):
            return None
        first, second, third = (number(place) for place in places)
        return first, second, third

    sigma, fix = triple(columns.sigma), _fix(row, columns.fix, line)
    if sigma and min(sigma) <= 0:
        raise ValueError(f"line {line} has a standard deviation that isn't above zero")
    return TablePosition(
        name=row[columns.name].strip(),
        line=line,
        x=number(columns.place[0]),
        y=number(columns.place[1]),
        height=number(columns.height),
        altitude_kind=columns.altitude_kind,
        sigma=sigma,
        fix=fix,
        gimbal=triple(columns.angles),
    )


def _fix(row: list[str], column: int | None, line: int) -> Fix | None:
    word = row[column].strip().lower() if column is not None and column < len(row) else ""
    for fix in get_args(Fix):
        if word == fix:
            return fix  # type: ignore[no-any-return]
    if word:
        raise ValueError(f"line {line} has the fix '{word}', which is none of {', '.join(get_args(Fix))}")
    return None


def _require_distinct(positions: Sequence[TablePosition], path: Path) -> None:
    first: dict[str, int] = {}
    for position in positions:
        if position.name.lower() in first:
            raise InputError(
                f"'{position.name}' stands in line {first[position.name.lower()]} and in line {position.line}",
                where=str(path),
                cure="keep one line for a photograph",
            )
        first[position.name.lower()] = position.line
