"""What enters the survey: the photographs found, read, and sorted out by their metadata."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.errors import InputError
from slideframe.formats.posed_model import PosedModel
from slideframe.georeferencing import undulation
from slideframe.stages import Context
from slideframe_pose_rtk.altitude import AltitudeRules, settle_altitudes
from slideframe_pose_rtk.calibration import calibrated, read_calibration
from slideframe_pose_rtk.intrinsics import camera_of
from slideframe_pose_rtk.jpeg import lacks_its_end
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.model_views import filled_from_model
from slideframe_pose_rtk.naming import names
from slideframe_pose_rtk.positions import PositionFiles, improve_positions
from slideframe_pose_rtk.reading import read_record
from slideframe_pose_rtk.twins import without_twins

SUFFIXES = frozenset({".jpg", ".jpeg"})
LEAST_PHOTOGRAPHS = 3  # two rays per point leave the shape of the ground along the base line undetermined
LEAST_EXTENT = 1.0  # m; from closer together, depth can't be told from noise
SITE_RADIUS = 5000.0  # m; a position farther from the median one belongs to another place
METERS_PER_DEGREE = 111_320.0  # of latitude


def photograph_files(folder: Path) -> list[Path]:
    """Return the JPEG files under a folder, in the order of their relative paths.

    Raises:
        InputError: the folder is missing, or holds no photographs.
    """
    if not folder.is_dir():
        raise InputError(
            "the folder of photographs doesn't exist" if not folder.exists() else "photographs must name a folder",
            where=str(folder),
            cure="give the folder that holds the drone's JPEG files",
        )
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    if not files:
        raise InputError(
            "the folder holds no photographs",
            where=str(folder),
            cure="put the drone's .jpg files there, as the camera wrote them",
        )
    return files


@dataclass(frozen=True)
class Sources:
    """What the user gives beside the photographs.

    Attributes:
        positions: better positions.
        altitudes: what heights mean.
        calibration: the user's own calibration of cameras, see `calibration`.
    """

    positions: PositionFiles = field(default_factory=PositionFiles)
    altitudes: AltitudeRules = field(default_factory=AltitudeRules)
    calibration: Path | None = None

    def paths(self, photographs: Sequence[Path]) -> list[Path]:
        """Return every file beside the photographs that the survey depends on."""
        given = [path for path in (self.calibration, self.altitudes.geoid.geoid_grid) if path is not None]
        return given + self.positions.paths(photographs)


def require_some_located(
    files: Sequence[Path], folder: Path, sources: Sources, model: PosedModel | None = None
) -> None:
    """Read what the user gives, then photographs until three with a position are found.

    An imported `model` with a reference of its own knows their positions.

    Raises:
        InputError: there are fewer, or something given can't be used.
    """
    if sources.calibration is not None:
        read_calibration(sources.calibration)
    sources.positions.require_readable(files)
    located = 0
    for path in files:
        try:
            record = read_record(path)
        except InputError:
            continue
        located += record.is_located
        if record.is_located and located == 1:
            undulation(sources.altitudes.geoid, np.array([record.latitude]), np.array([record.longitude]))
        if located == LEAST_PHOTOGRAPHS or (located and sources.positions.table):
            return
    if sources.positions.table is None and (model is None or model.georeference is None):
        raise _too_few(located, "with a position in their metadata", folder, imported=model is not None)


def admit(
    files: Sequence[Path],
    folder: Path,
    context: Context,
    sources: Sources | None = None,
    model: PosedModel | None = None,
) -> tuple[list[PhotoRecord], list[str]]:
    """Return the usable records and their files' SHA-256, warning by name of what is left out or doubtful, and why.

    An imported `model` knows the camera and the place of photographs that don't tell theirs.

    Raises:
        InputError: fewer than three photographs are usable, or something that the user gives can't be used.
    """
    sources = sources or Sources()
    records, digests = _readable(files, context)
    if sources.calibration is not None:
        records = calibrated(records, read_calibration(sources.calibration), sources.calibration)
    if model is not None:
        records = filled_from_model(records, model, folder)
    records = [record for record in records if _has_camera(record, context)]
    records = improve_positions(records, sources.positions, folder, sources.altitudes.geoid, context)
    records = _kept(
        records,
        [record.is_located for record in records],
        "no latitude, longitude and height in their metadata",
        context,
    )
    records = _kept(records, _near_the_site(records), f"more than {SITE_RADIUS / 1000:.0f} km from the others", context)
    records = without_twins(records, context)
    require_enough(len(records), "with a usable position", folder)
    _pass_warnings_on(records, context)
    records = settle_altitudes(records, sources.altitudes, context)
    context.figure("positions_from", _counted(record.position_source or "" for record in records))
    context.figure("position_fixes", _counted(record.fix for record in records))
    return records, [digests[record.path] for record in records]


def require_enough(count: int, what: str, folder: Path) -> None:
    """Refuse fewer than three photographs.

    Raises:
        InputError: there are fewer.
    """
    if count < LEAST_PHOTOGRAPHS:
        raise _too_few(count, what, folder)


def require_baseline(positions: np.ndarray, folder: Path) -> None:
    """Refuse photographs (photograph, 3), m, taken from one point, which show no depth.

    Raises:
        InputError: they lie within a metre.
    """
    extent = float(np.linalg.norm(np.ptp(positions, axis=0)))
    if extent < LEAST_EXTENT:
        raise InputError(
            f"all photographs were taken from one point (their positions lie within {extent:.2f} m)",
            where=str(folder),
            cure="photograph the slope from several places, with an overlap of 70 % or more",
        )


def _too_few(count: int, what: str, folder: Path, *, imported: bool = False) -> InputError:
    cure = "add photographs as the drone wrote them; programs that edit or send pictures often remove the position"
    if imported:
        cure += ". The imported model states no place on Earth either: export it with its georeference, or give"
        cure += " positions"
    return InputError(
        f"at least {LEAST_PHOTOGRAPHS} photographs {what} are needed, and there are {count}",
        where=str(folder),
        cure=cure,
    )


def _readable(files: Sequence[Path], context: Context) -> tuple[list[PhotoRecord], dict[Path, str]]:
    """Read every file once, leaving out the unreadable and the repeated; return SHA-256 by path as well."""
    records: list[PhotoRecord] = []
    digests: dict[Path, str] = {}
    first: dict[str, Path] = {}
    for path in files:
        try:
            record, digest = read_record(path), hashlib.sha256(path.read_bytes()).hexdigest()
            _require_whole(path)
        except InputError as error:
            context.warn(f"{path.name} is left out: {error.what}")
            continue
        if digest in first:
            context.warn(f"{path.name} is left out: it's the same file as {first[digest].name}")
            continue
        first[digest] = path
        records.append(record)
        digests[path] = digest
    return records, digests


def _has_camera(record: PhotoRecord, context: Context) -> bool:
    """Tell whether the photograph's focal length is known; without one it's of no use."""
    try:
        camera_of(record)
    except InputError as error:
        context.warn(f"{record.path.name} is left out: {error.what}")
        return False
    return True


def _require_whole(path: Path) -> None:
    """Refuse a picture whose data break off; only those that may are decoded.

    Raises:
        InputError: the picture can't be decoded to its last row.
    """
    if not lacks_its_end(path):
        return
    try:
        with Image.open(path) as picture:
            picture.load()
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(
            "its picture is cut off: the file ends too early", where=str(path), cure="copy it from the drone again"
        ) from error


def _pass_warnings_on(records: Sequence[PhotoRecord], context: Context) -> None:
    """Say what is doubtful about the photographs, once for all that share it."""
    for warning in sorted({warning for record in records for warning in record.warnings}):
        those = [record for record in records if warning in record.warnings]
        whose = names(those) if len(those) < 2 else f"each of {len(those)} photographs ({names(those)})"
        context.warn(f"{whose} {warning}")


def _near_the_site(records: Sequence[PhotoRecord]) -> np.ndarray:
    """Return which records lie near the median position."""
    if not records:
        return np.zeros(0, bool)
    places = np.array([(record.latitude, record.longitude) for record in records], np.float64)
    middle = np.median(places, axis=0)
    north = places[:, 0] - middle[0]
    east = ((places[:, 1] - middle[1] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(middle[0]))
    near: np.ndarray = np.hypot(north, east) * METERS_PER_DEGREE < SITE_RADIUS
    return near


def _kept(
    records: Sequence[PhotoRecord], kept: Sequence[bool] | np.ndarray, reason: str, context: Context
) -> list[PhotoRecord]:
    """Return those kept, warning of the others."""
    left_out = [record for record, keep in zip(records, kept, strict=True) if not keep]
    if left_out:
        context.warn(f"{len(left_out)} of {len(records)} photographs are left out, {reason}: {names(left_out)}")
    return [record for record, keep in zip(records, kept, strict=True) if keep]


def _counted(words: Iterable[str]) -> dict[str, float]:
    """Return how often each word stands."""
    return {word: float(count) for word, count in sorted(Counter(words).items())}
