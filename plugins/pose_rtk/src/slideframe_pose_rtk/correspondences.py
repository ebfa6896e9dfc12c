"""What the photographs of a flight have in common: features, matches, and headings that agree with them."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from slideframe.errors import InputError
from slideframe.stages import Context
from slideframe_pose_rtk.adjustment import triangulate
from slideframe_pose_rtk.control import Target
from slideframe_pose_rtk.database import write_database
from slideframe_pose_rtk.features import FeatureOptions, Features, PictureFile, find_features
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.freedom import Freedom, lenses_of
from slideframe_pose_rtk.headings import heading_offsets, turn_headings, warn_of_headings
from slideframe_pose_rtk.matching import Matches, match_photographs
from slideframe_pose_rtk.pairs import choose_pairs
from slideframe_pose_rtk.sessions import Session, sessions_of
from slideframe_pose_rtk.sighted import TargetRows, mark_features
from slideframe_pose_rtk.turned import turn_cameras, turned_pictures

if TYPE_CHECKING:
    import pycolmap


@dataclass(frozen=True)
class Correspondences:
    """All that the adjustment starts from.

    Attributes:
        flight: with headings set right, where matches contradicted them.
        sessions: the flights that the survey is made of.
        freedom: what of the cameras may change.
        lenses: COLMAP's cameras.
        features: of each photograph.
        matches: of each pair that shares a view.
        targets: surveyed points.
        target_rows: their rows among the features, by target and photograph.
        context: whose scratch folder holds COLMAP's database.
    """

    flight: Flight
    sessions: tuple[Session, ...]
    freedom: Freedom
    lenses: "list[pycolmap.Camera]"
    features: list[Features]
    matches: Matches
    targets: tuple[Target, ...]
    target_rows: TargetRows
    context: Context

    @property
    def database(self) -> Path:
        """COLMAP's database of features and matches, once `write` has written it."""
        return self.context.scratch / "features.db"

    def write(self) -> "Correspondences":
        """Write the database.

        Raises:
            InputError: no two photographs show the same ground.
        """
        if not self.matches:
            raise InputError(
                "no two photographs show the same ground",
                where=str(self.flight.folder),
                cure="fly with an overlap of 70 % or more; blurred, dark or uniform pictures can't be matched either",
            )
        write_database(self.database, self.flight, self.lenses, self.features, self.matches)
        return self

    def with_turned_pictures(self, poses: Poses, lenses: "list[pycolmap.Camera]") -> "Correspondences":
        """Return the same with turned cameras for the pictures that were turned, held; append these to `lenses`."""
        turns = turned_pictures(self.flight, poses, self.sessions)
        if not turns:
            return self
        count = len(lenses)
        flight = turn_cameras(self.flight, lenses, turns)
        held = self.freedom.held | set(range(count, len(lenses)))
        freedom = dataclasses.replace(self.freedom, held=held)
        return dataclasses.replace(self, flight=flight, lenses=lenses, freedom=freedom).write()

    def triangulate(self, lenses: "list[pycolmap.Camera]", poses: Poses, accepted: float) -> "pycolmap.Reconstruction":
        """Return the points that the posed photographs agree on."""
        scratch = self.context.scratch / "points"
        scratch.mkdir(exist_ok=True)
        return triangulate(self.database, self.flight, lenses, poses, accepted, self.context.seed, scratch)


def correspond(
    flight: Flight,
    pictures: list[PictureFile],
    freedom: Freedom,
    targets: tuple[Target, ...],
    options: FeatureOptions,
    partners: int,
    correct_headings: bool,
    context: Context,
) -> Correspondences:
    """Extract and match what isn't on the shelf already, and set headings right that the matches contradict.

    Raises:
        InputError: no two photographs show the same ground.
    """
    shelf = context.cache or context.scratch
    lenses, sessions = lenses_of(flight, freedom), sessions_of(flight.records)
    lens_of = [lenses[camera] for camera in flight.camera_of]
    features = find_features(pictures, options, shelf / "features", portion(context, 0.0, 0.4))

    def matched(known: Flight, start: float, end: float) -> Matches:
        pairs = choose_pairs(known, partners)
        return match_photographs(features, lens_of, pairs, shelf / "matches", portion(context, start, end))

    matches = matched(flight, 0.4, 0.65)
    offsets = heading_offsets(flight, lens_of, features, matches, sessions)
    warn_of_headings(offsets, correct_headings, context)
    if correct_headings and any(offset.is_unusual for offset in offsets):
        flight = turn_headings(flight, offsets)
        matches |= matched(flight, 0.65, 0.7)  # other headings, other partners
    marked, rows = mark_features(features, targets)
    return Correspondences(flight, sessions, freedom, lenses, marked, matches, targets, rows, context).write()


def portion(context: Context, start: float, end: float) -> Context:
    """Return the same context, whose progress runs from `start` to `end` of the stage."""

    def on_progress(done: float, total: float, figures: dict[str, float]) -> None:
        context.on_progress(start + (end - start) * done / total, 1.0, figures)

    return dataclasses.replace(context, on_progress=on_progress)
