"""Better positions than the photographs' own: the user's table, post-processed solutions, the drone's time marks.

Which one wins, for each photograph: the user's table always; else the better fix; of equal ones the
post-processed before the time mark, and that before the photograph's own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slideframe.errors import ConfigurationError, InputError
from slideframe.geodesy import enu_from_geodetic
from slideframe.georeferencing import Heights, to_geodetic
from slideframe.products import Georeference
from slideframe.stages import Context
from slideframe_pose_rtk.marks import Mark, mark_files, photograph_number, read_marks
from slideframe_pose_rtk.metadata import AltitudeKind, Fix, PhotoRecord, fix_of, gated, weight
from slideframe_pose_rtk.naming import listing, names
from slideframe_pose_rtk.table import Table, TablePosition, read_table
from slideframe_pose_rtk.trajectory import SUFFIX, WEEK, Trajectory, camera_position, read_trajectory

WGS84 = 4979
RANKS: dict[Fix, int] = {"fixed": 3, "float": 2, "single": 1, "none": 0}
# A mark farther from the photograph's own position than the worst of fixes belongs to another photograph.
FARTHEST_MARK = 50.0  # m

Update = dict[str, Any]


@dataclass(frozen=True)
class PositionFiles:
    """Where better positions may be.

    Attributes:
        table: the user's.
        epsg: coordinate system of the table's x and y.
        beside: whether to use the .MRK and .pos files beside the photographs.
    """

    table: Path | None = None
    epsg: int | None = None
    beside: bool = True

    def paths(self, photographs: Sequence[Path]) -> list[Path]:
        """Return the files that the positions depend on."""
        found = [] if self.table is None else [self.table]
        if self.beside:
            for marks in mark_files(photographs):
                found += [marks, *_solutions(marks)]
        return found

    def require_readable(self, photographs: Sequence[Path]) -> None:
        """Raise now what reading the files would raise later.

        Raises:
            InputError: a file can't be read.
            ConfigurationError: the table's coordinate system doesn't go with its columns.
        """
        if self.table is not None:
            _require_system(read_table(self.table), self.epsg)
        if self.beside:
            for marks in mark_files(photographs):
                read_marks(marks)


def improve_positions(
    records: Sequence[PhotoRecord], files: PositionFiles, folder: Path, geoid: Heights, context: Context
) -> list[PhotoRecord]:
    """Return the records with the best known positions.

    Raises:
        InputError: a file can't be read, or names no photograph at all.
        ConfigurationError: the table's coordinate system doesn't go with its columns.
    """
    improved = list(records)
    if files.beside:
        improved = _by_marks(improved, context)
    if files.table is not None:
        improved = _by_table(improved, files, folder, geoid, context)
    return improved


def _by_marks(records: Sequence[PhotoRecord], context: Context) -> list[PhotoRecord]:
    """Use the time marks in each photograph's folder, and the solutions beside them."""
    updates: dict[Path, list[tuple[int, Update]]] = {}
    for path in mark_files([record.path for record in records]):
        marks, trajectories = read_marks(path), [read_trajectory(solution) for solution in _solutions(path)]
        for record, mark in _matched(records, marks, path, context):
            updates.setdefault(record.path, []).extend(_candidates(mark, trajectories))
    return [_best(record, updates.get(record.path, [])) for record in records]


def _matched(
    records: Sequence[PhotoRecord], marks: dict[int, Mark], path: Path, context: Context
) -> Iterable[tuple[PhotoRecord, Mark]]:
    """Pair the photographs of the file's folder with the marks of their numbers, where the places agree too."""
    elsewhere = []
    for record in records:
        mark = marks.get(photograph_number(record) or -1)
        if mark is None or record.path.parent != path.parent:
            continue
        if record.latitude is not None and _distance(record, mark) > FARTHEST_MARK:
            elsewhere.append(record)
        else:
            yield record, mark
    if elsewhere:
        context.warn(
            f"{path.name}: the marks of {len(elsewhere)} photographs lie more than {FARTHEST_MARK:.0f} m from where the"
            f" photographs say they were taken, and aren't used: {names(elsewhere)}"
        )


def _candidates(mark: Mark, trajectories: Sequence[Trajectory]) -> Iterable[tuple[int, Update]]:
    """Yield what a mark offers, with its rank: fix first, then post-processed before real time."""
    fix = fix_of(mark.flag)
    yield (
        2 * RANKS[fix],
        {
            "latitude": mark.latitude,
            "longitude": mark.longitude,
            "height": mark.height,
            "altitude_kind": "ellipsoidal",
            "altitude_words": "time mark",
            "fix": fix,
            "rtk_flag": mark.flag,
            "rtk_sigma": mark.sigma,
            "covariance": weight(fix, mark.sigma),
            "position_source": "mrk",
        },
    )
    for trajectory in trajectories:
        antenna = trajectory.at((mark.week or 0) * WEEK + mark.time) if mark.week is not None else None
        if antenna is None:
            continue
        latitude, longitude, height = camera_position(antenna, mark.lever_arm)
        yield (
            2 * RANKS[antenna.fix] + 1,
            {
                "latitude": latitude,
                "longitude": longitude,
                "height": height,
                "altitude_kind": trajectory.altitude_kind,
                "altitude_words": "post-processed",
                "fix": antenna.fix,
                "covariance": gated(antenna.fix, antenna.covariance),
                "position_source": "ppk",
            },
        )


def _best(record: PhotoRecord, candidates: Sequence[tuple[int, Update]]) -> PhotoRecord:
    if not candidates:
        return record
    rank, update = max(candidates, key=lambda candidate: candidate[0])
    if record.latitude is not None and rank < 2 * RANKS[record.fix]:
        return record
    return record.model_copy(update=update)


def _by_table(
    records: Sequence[PhotoRecord], files: PositionFiles, folder: Path, geoid: Heights, context: Context
) -> list[PhotoRecord]:
    assert files.table is not None
    table = read_table(files.table)
    update_of = dict(zip(table.positions, _updates(table, files.epsg, geoid), strict=True))
    positions = {position.name.lower(): position for position in table.positions}
    named: dict[TablePosition, PhotoRecord] = {}
    improved = []
    for record in records:
        position = next((positions[key] for key in _keys(record, folder) if key in positions), None)
        if position in named:
            raise InputError(
                f"'{position.name}' in line {position.line} may be {named[position].path} or {record.path}",
                where=str(table.path),
                cure="name photographs by their paths below the folder of photographs",
            )
        if position is not None:
            named[position] = record
        improved.append(record.model_copy(update=update_of[position]) if position else record)
    without = [record for record in records if record not in named.values()]
    _report_table(table, list(named), without, context)
    return improved


def _keys(record: PhotoRecord, folder: Path) -> tuple[str, str, str]:
    """Return what a table may call a photograph: path below the folder, file name, or the name without its suffix."""
    return record.path.relative_to(folder).as_posix().lower(), record.path.name.lower(), record.path.stem.lower()


def _require_system(table: Table, epsg: int | None) -> None:
    """Refuse a coordinate system beside degrees, and eastings without one."""
    if table.geographic and epsg is not None:
        raise ConfigurationError(
            "positions_epsg goes with the columns easting and northing, or x and y",
            where=str(table.path),
            cure="leave positions_epsg out",
        )
    if not table.geographic and epsg is None:
        raise ConfigurationError(
            "the table has eastings and northings, and nothing says in which coordinate system",
            where=str(table.path),
            cure="give positions_epsg, such as 2326",
        )


def _updates(table: Table, epsg: int | None, geoid: Heights) -> Iterable[Update]:
    """Yield what each line changes, its place in WGS84."""
    _require_system(table, epsg)
    for position, (latitude, longitude, height, kind) in zip(table.positions, _places(table, epsg, geoid), strict=True):
        fix = position.fix or "fixed"
        update: Update = {
            "latitude": latitude,
            "longitude": longitude,
            "height": height,
            "altitude_kind": kind,
            "altitude_words": "table",
            "fix": fix,
            "rtk_sigma": position.sigma,
            "covariance": weight(fix, position.sigma),
            "position_source": "csv",
        }
        if position.gimbal:
            update |= {"gimbal": position.gimbal, "gimbal_source": "csv"}
        yield update


def _places(table: Table, epsg: int | None, geoid: Heights) -> Iterable[tuple[float, float, float, AltitudeKind]]:
    """Yield latitude, longitude, height and what the height is measured from."""
    kinds = [position.altitude_kind for position in table.positions]
    points = np.array([(position.x, position.y, position.height) for position in table.positions], np.float64)
    if epsg is None:
        for (x, y, height), kind in zip(points.tolist(), kinds, strict=True):
            yield y, x, height, kind
        return
    # a table has one column of heights, so that all are alike; with a geoid, they are needed for the place as well
    raised = kinds[0] == "orthometric" and geoid.undulation_given
    geodetic = to_geodetic(points, epsg, geoid if raised else Heights())
    for latitude, longitude, height in geodetic.tolist():
        yield latitude, longitude, height, "ellipsoidal" if raised else kinds[0]


def _report_table(
    table: Table, named: Sequence[TablePosition], without: Sequence[PhotoRecord], context: Context
) -> None:
    """Say which lines name no photograph, and which photographs no line names."""
    if not named:
        raise InputError(
            f"none of its {len(table.positions)} names is a photograph's, the first being '{table.positions[0].name}'",
            where=str(table.path),
            cure="name photographs as their files are named, or by their paths below the folder of photographs",
        )
    unknown = [position.name for position in table.positions if position not in named]
    if unknown:
        context.warn(f"{table.path.name} names {len(unknown)} photographs that aren't there: {listing(unknown)}")
    if without:
        context.warn(
            f"{table.path.name} lacks {len(without)} photographs, which keep other positions: {names(without)}"
        )


def _solutions(marks: Path) -> list[Path]:
    """Return RTKLIB's solutions beside a file of time marks: those whose names begin as the flight's does."""
    flight = marks.stem.removesuffix("_Timestamp")
    return sorted(path for path in marks.parent.glob(f"*{SUFFIX}") if path.name.startswith(flight))


def _distance(record: PhotoRecord, mark: Mark) -> float:
    """Return the horizontal distance between a photograph's own position and a mark, m."""
    assert record.latitude is not None
    assert record.longitude is not None
    origin = Georeference(latitude=record.latitude, longitude=record.longitude, ellipsoidal_height=mark.height)
    east, north, _ = enu_from_geodetic(np.array([[mark.latitude, mark.longitude, mark.height]]), origin)[0]
    return float(np.hypot(east, north))
