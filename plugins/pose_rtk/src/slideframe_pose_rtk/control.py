"""Surveyed points on the ground, and where the photographs show them: control and check points."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError, InputError
from slideframe.geodesy import enu_from_geodetic
from slideframe.georeferencing import ELLIPSOIDAL, Heights, to_geodetic, undulation
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.gcp_list import read_gcp_list

Role = Literal["control", "check"]

CURE = (
    "give name, latitude and longitude or easting and northing, ellipsoidal_height or orthometric_height, photograph,"
    " column and row, and role (control or check) where some are checks; a line for each sighting"
)
GEOGRAPHIC, PROJECTED = ("latitude", "longitude"), ("easting", "northing")
HEIGHTS = ("ellipsoidal_height", "orthometric_height")
SIGHTING = ("photograph", "column", "row")
SAME = 1e-6  # degrees or m that two lines of one point may differ by


@dataclass(frozen=True)
class ControlFile:
    """The user's file, and what its coordinates are.

    Attributes:
        path: a CSV file, see docs/survey.md, or OpenDroneMap's gcp_list.txt.
        epsg: coordinate system of easting and northing; one with a vertical part says what the heights are, too.
        geoid: how far sea level lies above the ellipsoid.
    """

    path: Path
    epsg: int | None = None
    geoid: Heights = ELLIPSOIDAL


@dataclass(frozen=True, eq=False)
class Target:
    """One surveyed point.

    Attributes:
        name: unique.
        role: control shapes the survey, a check is only compared with it.
        position: (3,), m, in the local frame.
        sightings: (column, row) px by photograph; (0.5, 0.5) is the centre of the upper-left pixel.
    """

    name: str
    role: Role
    position: Float64Array
    sightings: dict[int, tuple[float, float]]


@dataclass
class _Point:
    role: Role
    place: tuple[float, float, float]
    sightings: dict[str, tuple[float, float]]


def read_targets(file: ControlFile, flight: Flight) -> tuple[Target, ...]:
    """Read the points; sightings in photographs that aren't in the survey are left out.

    Raises:
        InputError: the file can't be read, contradicts itself, or none of its photographs is in the survey.
        ConfigurationError: its coordinates don't go with `epsg`.
    """
    points, header, file = _read(file)
    positions = _local(np.array([point.place for point in points.values()]), header, file, flight)
    by_name = {flight.name(index): index for index in range(len(flight))}
    by_name |= {flight.records[index].path.name: index for index in range(len(flight))}
    targets = tuple(
        Target(name, point.role, position, {by_name[n]: pixel for n, pixel in point.sightings.items() if n in by_name})
        for (name, point), position in zip(points.items(), positions, strict=True)
    )
    if not any(target.sightings for target in targets):
        raise InputError(
            "none of the photographs that it names is in the survey",
            where=str(file.path),
            cure="name them by their files, such as " + flight.name(0),
        )
    return targets


def require_readable(file: ControlFile) -> None:
    """Raise now what `read_targets` would raise later, but for the photographs.

    Raises:
        InputError, ConfigurationError: as `read_targets`.
    """
    _, header, file = _read(file)
    _require_system(header, file)


def _read(file: ControlFile) -> tuple[dict[str, _Point], list[str], ControlFile]:
    """Return the points, the columns, and the file with its coordinate system, which a gcp_list.txt states itself."""
    path = file.path
    if path.suffix.lower() == ".txt":
        epsg, rows = read_gcp_list(path)
        header = [*(PROJECTED if epsg else GEOGRAPHIC), HEIGHTS[1] if file.geoid.undulation_given else HEIGHTS[0]]
        columns: Sequence[str] = (*header[:2], HEIGHTS[0])
        file = ControlFile(path, epsg, file.geoid)
    else:
        header, columns, rows = _table(path)
    points: dict[str, _Point] = {}
    for number, row in rows:
        try:
            _add(points, row, columns)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"line {number} of the surveyed points: {error}", where=str(path), cure=CURE) from error
    if not points:
        raise InputError("the file of surveyed points is empty", where=str(path), cure=CURE)
    return points, header, file


def _table(path: Path) -> tuple[list[str], Sequence[str], list[tuple[int, dict[str, str]]]]:
    """Return the header of a CSV file, the columns of a place, and each line's number with its fields."""
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the surveyed points can't be read: {error}", where=str(path), cure=CURE) from error
    if not lines:
        raise InputError("the file of surveyed points is empty", where=str(path), cure=CURE)
    rows = csv.DictReader(lines, delimiter=max(",;\t", key=lines[0].count))
    header = [(name or "").strip().lower() for name in rows.fieldnames or ()]
    rows.fieldnames = header
    places = [pair for pair in (GEOGRAPHIC, PROJECTED) if set(pair) <= set(header)]
    heights = [name for name in HEIGHTS if name in header]
    if len(places) != 1 or len(heights) != 1 or not {"name", *SIGHTING} <= set(header):
        raise InputError(f"its columns are {', '.join(header)}", where=str(path), cure=CURE)
    return header, (*places[0], heights[0]), list(enumerate(rows, 2))


def _add(points: dict[str, _Point], row: dict[str, str], columns: Sequence[str]) -> None:
    name, role = row["name"].strip(), (row.get("role") or "control").strip().lower()
    if not name:
        raise ValueError("it has no name")
    if role not in ("control", "check"):
        raise ValueError(f"the role '{role}' is neither control nor check")
    first, second, third = (_number(row[column], column) for column in columns)
    point = points.setdefault(name, _Point("check" if role == "check" else "control", (first, second, third), {}))
    if max(abs(a - b) for a, b in zip(point.place, (first, second, third), strict=True)) > SAME or point.role != role:
        raise ValueError(f"'{name}' has another place or role than before")
    photograph = (row["photograph"] or "").strip()
    if photograph:
        point.sightings[photograph] = _number(row["column"], "column"), _number(row["row"], "row")


def _number(text: str | None, column: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"'{text}' in {column} is no number")
    return value


def _local(places: Float64Array, header: list[str], file: ControlFile, flight: Flight) -> Float64Array:
    _require_system(header, file)
    if file.epsg is not None:
        vertical = file.geoid if _is_orthometric(header) and not _has_vertical_part(file.epsg) else ELLIPSOIDAL
        geodetic = to_geodetic(places, file.epsg, vertical)
    else:
        geodetic = places.copy()
        if _is_orthometric(header):
            geodetic[:, 2] += undulation(file.geoid, places[:, 0], places[:, 1])
    return enu_from_geodetic(geodetic, flight.georeference)


def _require_system(header: list[str], file: ControlFile) -> None:
    projected = set(PROJECTED) <= set(header)
    if projected != (file.epsg is not None):
        raise ConfigurationError(
            "easting and northing need their coordinate system" if projected else "degrees need no coordinate system",
            where="plugins.pose_rtk.control_epsg",
            cure="give the EPSG code, such as 2326" if projected else "leave it out: they are WGS84's",
        )
    known = file.geoid.undulation_given or (file.epsg is not None and _has_vertical_part(file.epsg))
    if _is_orthometric(header) and not known:
        raise ConfigurationError(
            "orthometric heights need the level of the sea above the ellipsoid",
            where=str(file.path),
            cure="give plugins.pose_rtk.geoid_offset or geoid_grid, or a control_epsg with a vertical part",
        )


def _is_orthometric(header: list[str]) -> bool:
    return HEIGHTS[1] in header


def _has_vertical_part(epsg: int) -> bool:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return bool(CRS.from_epsg(epsg).is_compound)
    except CRSError:
        return False  # `to_geodetic` says what is wrong with it
