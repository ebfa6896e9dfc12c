"""Poses, cameras and sparse points: as metadata gives them, or refined."""

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe.stages import Context
from slideframe_pose_rtk.adjustment import (
    ACCEPTED_ANGLES,
    Freedom,
    Poses,
    accepted_pixels,
    adjust,
    metadata_poses,
    poses_of,
    triangulate,
)
from slideframe_pose_rtk.database import write_database
from slideframe_pose_rtk.features import FeatureOptions, find_features
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.intake import names, require_enough
from slideframe_pose_rtk.lens import adjustable_lens, camera_from_lens, exact_lens, pinhole_lens
from slideframe_pose_rtk.matching import match_photographs
from slideframe_pose_rtk.pairs import choose_pairs, ground_height
from slideframe_pose_rtk.resection import resect
from slideframe_pose_rtk.sparse import SparsePoints, sparse_points

if TYPE_CHECKING:
    import pycolmap

FocalLength = Literal["auto", "held", "free"]

# Nadir views from one height fit any focal length, trading it for height (measured: 1913 to 2470 px at equal error).
OBLIQUE_ANGLE = 15.0  # degrees off nadir
OBLIQUE_SHARE = 0.25
HEIGHT_SPREAD = 0.2  # of the flying height
LEAST_FOR_CALIBRATION = 8  # photographs of one camera; fewer leave its distortion to chance
HELD = Freedom(focal_length=False, principal_point=False, distortion=False)


@dataclass(frozen=True)
class Solution:
    """What the photographs' metadata and matches determine.

    Attributes:
        poses: world from camera (3, 4) by photograph.
        cameras: as adjusted, or as they were.
        camera_of: index into `cameras` by photograph.
        points: the sparse points.
        focal_length_rule: whether the focal length was held or free, and why.
        refined: whether the poses differ from metadata's at all.
    """

    poses: Poses
    cameras: tuple[Camera, ...]
    camera_of: Mapping[int, int]
    points: SparsePoints
    focal_length_rule: str
    refined: bool


class Correspondences:
    """The features and matches of a flight, and COLMAP's database of them in the stage's scratch folder."""

    def __init__(
        self,
        flight: Flight,
        digests: list[str],
        freedom: Freedom,
        options: FeatureOptions,
        partners: int,
        context: Context,
    ) -> None:
        """Extract and match what isn't on the shelf already.

        Raises:
            InputError: no two photographs show the same ground.
        """
        self.flight, self.freedom, self.context = flight, freedom, context
        self.lenses = lenses_of(flight, freedom)
        self.path = context.scratch / "features.db"
        shelf = context.cache or context.scratch
        paths = [record.path for record in flight.records]
        self.features = find_features(paths, digests, options, shelf / "features", _portion(context, 0.0, 0.4))
        lens_of = [self.lenses[camera] for camera in flight.camera_of]
        pairs = choose_pairs(flight, partners)
        self.matches = match_photographs(self.features, lens_of, pairs, shelf / "matches", _portion(context, 0.4, 0.7))
        if not self.matches:
            raise InputError(
                "no two photographs show the same ground",
                where=str(flight.folder),
                cure="fly with an overlap of 70 % or more; blurred, dark or uniform pictures can't be matched either",
            )
        write_database(self.path, flight, self.lenses, self.features, self.matches)

    def triangulate(self, lenses: "list[pycolmap.Camera]", poses: Poses, accepted: float) -> "pycolmap.Reconstruction":
        """Return the points that the posed photographs agree on."""
        scratch = self.context.scratch / "points"
        scratch.mkdir(exist_ok=True)
        return triangulate(self.path, self.flight, lenses, poses, accepted, self.context.seed, scratch)


@contextmanager
def quiet_colmap() -> Iterator[None]:
    """Keep COLMAP's log, which belongs to the process, to errors for a while."""
    import pycolmap

    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level


def solve_from_metadata(correspondences: Correspondences) -> Solution:
    """Keep metadata's poses and cameras, as the paper does, and triangulate with room for their errors."""
    flight = correspondences.flight
    accepted = accepted_pixels(flight)[0]
    poses = metadata_poses(flight)
    reconstruction = correspondences.triangulate(correspondences.lenses, poses, accepted)
    points = sparse_points(flight, reconstruction, accepted)
    rule = "held: metadata's cameras are kept as they are"
    return Solution(poses, flight.cameras, dict(enumerate(flight.camera_of)), points, rule, refined=False)


def solve_by_refinement(correspondences: Correspondences) -> Solution:
    """Alternate triangulation and bundle adjustment with position priors, accepting less error in every round.

    The first round moves poses and points alone; from the second on, cameras adjust too, and photographs without a
    pose, or that nobody agrees with, are resected from the points of the others.

    Raises:
        InputError: fewer than three photographs can be registered.
    """
    flight, freedom, context = correspondences.flight, correspondences.freedom, correspondences.context
    lenses, poses = correspondences.lenses, metadata_poses(flight)
    rounds = accepted_pixels(flight)
    for number, accepted in enumerate(rounds):
        reconstruction = correspondences.triangulate(lenses, poses, accepted)
        require_enough(len(poses_of(reconstruction)), "that share enough detail with others", flight.folder)
        round_freedom = freedom if number else HELD
        adjust(reconstruction, flight, round_freedom, accepted, context.seed)
        lenses = [adjusted_lens(reconstruction, lens) for lens in lenses]
        poses = poses_of(reconstruction)
        if 0 < number < len(ACCEPTED_ANGLES):
            missing = [index for index in range(len(flight)) if index not in poses]
            poses |= resect(
                correspondences.features,
                correspondences.matches,
                reconstruction,
                lenses,
                flight,
                missing,
                context.seed,
            )
        error = float(reconstruction.compute_mean_reprojection_error())
        context.progress(0.7 + 0.3 * (number + 1) / len(rounds), 1.0, reprojection_error_px=error)
    require_enough(len(poses), "that can be registered", flight.folder)
    cameras = tuple(camera_from_lens(lens) for lens in lenses)
    points = sparse_points(flight, reconstruction, rounds[-1])
    return Solution(poses, cameras, dict(enumerate(flight.camera_of)), points, freedom.rule, refined=True)


def warn_of_unregistered(flight: Flight, solution: Solution, context: Context) -> None:
    """Name the photographs that have no pose."""
    lost = [record for index, record in enumerate(flight.records) if index not in solution.poses]
    if lost:
        context.warn(f"{len(lost)} of {len(flight)} photographs couldn't be registered and are left out: {names(lost)}")


def choose_freedom(flight: Flight, focal_length: FocalLength) -> Freedom:
    """Free focal length and principal point only where the flight determines them, unless the user decides."""
    free, rule = _focal_length_rule(flight) if focal_length == "auto" else (focal_length == "free", "as asked for")
    counts = np.bincount(flight.camera_of, minlength=len(flight.cameras))
    held = np.flatnonzero(counts < LEAST_FOR_CALIBRATION)
    if free and len(held) == len(flight.cameras):
        free, rule = False, f"no camera took {LEAST_FOR_CALIBRATION} photographs"
    return Freedom(
        focal_length=free,
        principal_point=free,
        distortion=True,
        held=frozenset(int(camera) for camera in held),
        rule=f"{'free' if free else 'held'}: {rule}",
    )


def _focal_length_rule(flight: Flight) -> tuple[bool, str]:
    """Tell whether oblique views or several heights determine the focal length, and how that was seen."""
    oblique, spread = _oblique_share(flight), _height_spread(flight)
    if oblique >= OBLIQUE_SHARE:
        return True, f"{oblique:.0%} of the views are oblique"
    if spread >= HEIGHT_SPREAD:
        return True, f"flying heights differ by {spread:.0%}"
    return False, f"only {oblique:.0%} of the views are oblique and heights differ by {spread:.0%}: any value would fit"


def lenses_of(flight: Flight, freedom: Freedom) -> "list[pycolmap.Camera]":
    """Return COLMAP's cameras, numbered from 1: exact where they stay as they are, else in models that adjust well."""
    dewarped = {camera for camera, record in zip(flight.camera_of, flight.records, strict=True) if record.is_dewarped}
    lenses = []
    for index, camera in enumerate(flight.cameras):
        if index in freedom.held or not freedom.distortion:
            lenses.append(exact_lens(camera, index + 1))
        elif index in dewarped:
            lenses.append(pinhole_lens(camera, index + 1))
        else:
            lenses.append(adjustable_lens(camera, index + 1))
    return lenses


def adjusted_lens(reconstruction: "pycolmap.Reconstruction", lens: "pycolmap.Camera") -> "pycolmap.Camera":
    """Return the lens as adjusted, or as it was if COLMAP left it out because nothing matches its photographs."""
    adjusted: pycolmap.Camera = (
        reconstruction.camera(lens.camera_id) if reconstruction.exists_camera(lens.camera_id) else lens
    )
    return adjusted


def _oblique_share(flight: Flight) -> float:
    downward = -flight.rotations[flight.oriented][:, 2, 2]
    return float(np.mean(downward < np.cos(np.radians(OBLIQUE_ANGLE)))) if len(downward) else 0.0


def _height_spread(flight: Flight) -> float:
    heights = flight.positions[:, 2] - ground_height(flight)
    return float(np.ptp(heights) / np.median(heights))


def _portion(context: Context, start: float, end: float) -> Context:
    """Return the same context, whose progress runs from `start` to `end` of the stage."""

    def on_progress(done: float, total: float, figures: dict[str, float]) -> None:
        context.on_progress(start + (end - start) * done / total, 1.0, figures)

    return dataclasses.replace(context, on_progress=on_progress)
