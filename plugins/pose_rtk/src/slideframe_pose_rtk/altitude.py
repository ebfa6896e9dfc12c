"""Heights brought to one level: the WGS84 ellipsoid's, wherever the files or the user say how."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slideframe.errors import InputError
from slideframe.georeferencing import ELLIPSOIDAL, Heights, undulation
from slideframe.stages import Context
from slideframe_pose_rtk.metadata import AltitudeKind, PhotoRecord
from slideframe_pose_rtk.naming import names

# Among ellipsoidal heights, one above another level may be off by the geoid's undulation (-107 to +86 m on Earth).
UNDULATION_SIGMA = 50.0
LEVELS: dict[AltitudeKind, str] = {
    "orthometric": "above sea level",
    "relative": "above the place of take-off",
    "unknown": "on a level that the file doesn't state",
}


@dataclass(frozen=True)
class AltitudeRules:
    """What the user says of heights.

    Attributes:
        geoid: how far sea level lies above the ellipsoid; without, orthometric heights stay what they are.
        unstated: what to take heights of an unknown level for.
        mixed_refused: whether heights on several levels are an error, because nothing will adjust them.
    """

    geoid: Heights = ELLIPSOIDAL
    unstated: Literal["unknown", "ellipsoidal", "orthometric"] = "unknown"
    mixed_refused: bool = False


def settle_altitudes(records: Sequence[PhotoRecord], rules: AltitudeRules, context: Context) -> list[PhotoRecord]:
    """Return the records with ellipsoidal heights where that can be said, and doubtful ones where levels mix.

    Nothing is guessed: without the user's word, heights on other levels stay as they are, named in a
    warning. Where levels mix, those not ellipsoidal lose their weight, and start from where the heights above take-off
    put them, for an adjustment can't begin with cameras below the ground.

    Raises:
        InputError: the geoid grid can't be used at a photograph's place, or levels mix and mustn't.
    """
    told = [_as_told(record, rules) for record in records]
    settled = _above_ellipsoid(told, rules.geoid)
    kinds = {record.altitude_kind for record in settled}
    if len(kinds) > 1 and rules.mixed_refused:
        raise _mixed(settled)
    _warn_of_levels(settled, context)
    if len(kinds) < 2:
        return settled
    steps = {kind: _step_to_ellipsoid(settled, kind) for kind in kinds}
    return [
        record if record.altitude_kind == "ellipsoidal" else _doubted(record, steps[record.altitude_kind])
        for record in settled
    ]


def _step_to_ellipsoid(records: Sequence[PhotoRecord], kind: AltitudeKind) -> float:
    """Return how much higher ellipsoidal heights put the place of take-off than those of a kind, m; 0 if unknown."""
    places = []
    for level in ("ellipsoidal", kind):
        take_off = [
            record.height - record.height_above_takeoff
            for record in records
            if record.altitude_kind == level and record.height is not None and record.height_above_takeoff is not None
        ]
        places.append(float(np.median(take_off)) if take_off else None)
    first, second = places
    return 0.0 if first is None or second is None else first - second


def _as_told(record: PhotoRecord, rules: AltitudeRules) -> PhotoRecord:
    if record.altitude_kind != "unknown":
        return record
    return record.model_copy(update={"altitude_kind": rules.unstated})


def _above_ellipsoid(records: Sequence[PhotoRecord], geoid: Heights) -> list[PhotoRecord]:
    """Raise orthometric heights by the undulation, where the user gives one."""
    rows = [row for row, record in enumerate(records) if record.altitude_kind == "orthometric"]
    settled = list(records)
    if not rows or not geoid.undulation_given:
        return settled
    latitude, longitude = np.array([(records[row].latitude, records[row].longitude) for row in rows], np.float64).T
    for row, offset in zip(rows, undulation(geoid, latitude, longitude), strict=True):
        height = records[row].height
        assert height is not None
        settled[row] = records[row].model_copy(
            update={"height": height + float(offset), "altitude_kind": "ellipsoidal"}
        )
    return settled


def _warn_of_levels(records: Sequence[PhotoRecord], context: Context) -> None:
    """Say which heights aren't ellipsoidal, and what that means."""
    kinds = {record.altitude_kind for record in records}
    for kind in sorted(kinds - {"ellipsoidal"}):
        those = [record for record in records if record.altitude_kind == kind]
        words = ", ".join(sorted({record.altitude_words for record in those} - {""}))
        consequence = (
            "beside heights on other levels, theirs count for little, and start from those above take-off"
            if len(kinds) > 1
            else "the survey's own shape doesn't suffer, its absolute height may be tens of metres off"
        )
        context.warn(
            f"{len(those)} of {len(records)} photographs have heights {LEVELS[kind]}{f' ({words})' if words else ''}:"
            f" {consequence}; geoid_offset, geoid_grid and unstated_altitude tell what they are: {names(those)}"
        )


def _mixed(records: Sequence[PhotoRecord]) -> InputError:
    """Return the error that names the photographs on each level."""
    kinds = sorted({record.altitude_kind for record in records})
    those = [(kind, [record for record in records if record.altitude_kind == kind]) for kind in kinds]
    counts = "; ".join(f"{len(group)} {kind} ({names(group)})" for kind, group in those)
    return InputError(
        f"the photographs' heights lie on different levels, and nothing brings them together: {counts}",
        cure="give geoid_offset, geoid_grid or unstated_altitude, remove those photographs, or refine the poses",
    )


def _doubted(record: PhotoRecord, step: float) -> PhotoRecord:
    assert record.height is not None
    (east, ne, _), (_, north, _), (_, _, up) = record.covariance
    up = max(up, UNDULATION_SIGMA**2)
    covariance = ((east, ne, 0.0), (ne, north, 0.0), (0.0, 0.0, up))
    return record.model_copy(update={"covariance": covariance, "height": record.height + step})
