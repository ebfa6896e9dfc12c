"""RTKLIB's solutions (.pos): the antenna's way, post-processed, and where it was at an exposure."""

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.products import Georeference
from slideframe_pose_rtk.metadata import AltitudeKind, Fix, Triple

SUFFIX = ".pos"
# RTKLIB 2.4.2 manual, appendix B.1: solution quality
QUALITIES: dict[int, Fix] = {1: "fixed", 2: "float", 3: "single", 4: "single", 5: "single", 6: "float"}
GPS_EPOCH = datetime(1980, 1, 6)
WEEK = 604_800.0  # s
LEAP_SECONDS = 18.0  # GPS time ahead of UTC since 1 January 2017 (IERS Bulletin C)
WIDEST_GAP = 1.0  # s between epochs that a position may be interpolated in; receivers of drones give 5 to 10 a second
SAME_INSTANT = 1e-3  # s; solutions for events stand at the exposures themselves
NEIGHBORS = 2  # epochs before and after that the interpolating cubic passes through


@dataclass(frozen=True, eq=False)
class AntennaPosition:
    """Where the antenna was: degrees, m; covariance (3, 3) in m², east, north, up."""

    latitude: float
    longitude: float
    height: float
    covariance: Float64Array
    fix: Fix


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Epochs in order of time.

    Attributes:
        times: (epoch,), GPS seconds since 6 January 1980.
        geodetic: (epoch, 3) latitude, longitude in degrees, height in m.
        qualities: (epoch,), RTKLIB's.
        covariances: (epoch, 3, 3), m², east, north, up.
        altitude_kind: what the heights are measured from.
    """

    times: Float64Array
    geodetic: Float64Array
    qualities: np.ndarray
    covariances: Float64Array
    altitude_kind: AltitudeKind

    def at(self, time: float) -> AntennaPosition | None:
        """Return the position at a GPS time, or None outside the solution or in a gap of it.

        Interpolated by the cubic through two epochs before and two after, in a local frame; quality and
        covariance are those of the worse neighbour.
        """
        after = int(np.searchsorted(self.times, time))
        beside = [row for row in (after - 1, after) if 0 <= row < len(self.times)]
        nearest = min(beside, key=lambda row: abs(float(self.times[row]) - time))
        if abs(self.times[nearest] - time) < SAME_INSTANT:
            return self._position(self.geodetic[nearest], nearest)
        if not 0 < after < len(self.times) or self.times[after] - self.times[after - 1] > WIDEST_GAP:
            return None
        rows = np.arange(max(0, after - NEIGHBORS), min(len(self.times), after + NEIGHBORS))
        rows = rows[np.abs(self.times[rows] - time) <= NEIGHBORS * WIDEST_GAP]
        worse = max((after - 1, after), key=lambda row: float(np.trace(self.covariances[row])))
        return self._position(_interpolated(self.times[rows] - time, self.geodetic[rows]), worse)

    def _position(self, geodetic: Float64Array, row: int) -> AntennaPosition:
        latitude, longitude, height = geodetic.tolist()
        fix = QUALITIES.get(int(self.qualities[row]), "none")
        return AntennaPosition(latitude, longitude, height, self.covariances[row], fix)


def read_trajectory(path: Path) -> Trajectory:
    """Read latitude, longitude, height solutions in GPS time or UTC.

    Raises:
        InputError: the file is of another kind, or a line can't be read.
    """
    lines = path.read_text(errors="replace").splitlines()
    header = "\n".join(line for line in lines if line.startswith("%"))
    ahead = _seconds_ahead(header, path)
    rows = []
    for number, line in enumerate(lines, 1):
        if line.strip() and not line.startswith("%"):
            rows.append(_row(line, number, path))
    if not rows:
        raise InputError("it holds no solution", where=str(path), cure="process it again, or move it away")
    table = np.array(sorted(rows), np.float64)
    return Trajectory(
        times=table[:, 0] + ahead,
        geodetic=table[:, 1:4],
        qualities=table[:, 4].astype(int),
        covariances=_covariances(table[:, 5:]),
        altitude_kind="orthometric" if "/geodetic" in header else "ellipsoidal",
    )


def camera_position(antenna: AntennaPosition, lever_arm: Triple) -> tuple[float, float, float]:
    """Return latitude, longitude, height of a camera `lever_arm` (m north, east, down) from the antenna."""
    north, east, down = lever_arm
    place = Georeference(latitude=antenna.latitude, longitude=antenna.longitude, ellipsoidal_height=antenna.height)
    latitude, longitude, height = geodetic_from_enu(np.array([[east, north, -down]]), place)[0].tolist()
    return latitude, longitude, height


def _interpolated(offsets: Float64Array, geodetic: Float64Array) -> Float64Array:
    """Return the value at zero of the polynomial (Lagrange's) through the positions at `offsets` s."""
    place = Georeference(latitude=geodetic[0, 0], longitude=geodetic[0, 1], ellipsoidal_height=geodetic[0, 2])
    local = enu_from_geodetic(geodetic, place)
    weights = [np.prod([other / (other - own) for other in np.delete(offsets, row)]) for row, own in enumerate(offsets)]
    position: Float64Array = geodetic_from_enu((np.array(weights) @ local)[None], place)[0]
    return position


def _seconds_ahead(header: str, path: Path) -> float:
    """Return what to add to the file's times to have GPS time."""
    if "latitude" not in header:
        raise InputError(
            "its solution isn't in latitude, longitude and height",
            where=str(path),
            cure="choose 'Lat/Lon/Height' as RTKLIB's solution format",
        )
    if re.search(r"^%\s+UTC\b", header, re.MULTILINE):
        return LEAP_SECONDS
    if re.search(r"^%\s+GPST\b", header, re.MULTILINE):
        return 0.0
    raise InputError(
        "its times are neither GPS time nor UTC", where=str(path), cure="choose GPST as RTKLIB's time format"
    )


def _row(line: str, number: int, path: Path) -> tuple[float, ...]:
    """Return time, latitude, longitude, height, quality and the six deviations of a line."""
    first, second, *fields = re.split(r"[,\s]+", line.strip())
    try:
        if "/" in first:
            clock = "%Y/%m/%d %H:%M:%S.%f" if "." in second else "%Y/%m/%d %H:%M:%S"
            time = (datetime.strptime(f"{first} {second}", clock) - GPS_EPOCH).total_seconds()
        else:
            time = int(first) * WEEK + float(second)
        latitude, longitude, height, quality, _, *deviations = (float(field) for field in fields[:11])
        if len(deviations) != 6:
            raise ValueError(f"{len(deviations)} deviations instead of 6")
    except ValueError as error:
        raise InputError(
            f"line {number} is no position: {error}",
            where=str(path),
            cure="choose RTKLIB's own format with all columns, separated by spaces or commas",
        ) from error
    return (time, latitude, longitude, height, quality, *deviations)


def _covariances(deviations: Float64Array) -> Float64Array:
    """Return (epoch, 3, 3) m² of RTKLIB's sdn, sde, sdu, sdne, sdeu, sdun, whose signs are the covariances'."""
    north, east, up, north_east, east_up, up_north = (np.sign(deviations) * deviations**2).T
    rows = [[east, north_east, east_up], [north_east, north, up_north], [east_up, up_north, up]]
    return np.moveaxis(np.array(rows), 2, 0)
