"""Poses, cameras and sparse points: as metadata gives them, or refined."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slideframe.products import Camera, GroundPoint
from slideframe.stages import Context
from slideframe_pose_rtk.adjustment import (
    ACCEPTED_ANGLES,
    accepted_pixels,
    adjust,
    metadata_poses,
    poses_of,
    priors_of,
)
from slideframe_pose_rtk.correspondences import Correspondences
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.freedom import HELD, Freedom
from slideframe_pose_rtk.intake import require_enough
from slideframe_pose_rtk.lens import camera_from_lens
from slideframe_pose_rtk.naming import names
from slideframe_pose_rtk.resection import resect
from slideframe_pose_rtk.sessions import Session
from slideframe_pose_rtk.sighted import add_control, compare, require_one_datum
from slideframe_pose_rtk.sparse import SparsePoints, sparse_points
from slideframe_pose_rtk.trust import Trust, warn_of_positions, weigh

if TYPE_CHECKING:
    import pycolmap


WEIGHINGS = 4
SETTLED = 1.1  # factor by which sigmas may still grow


@dataclass(frozen=True)
class Solution:
    """What the photographs' metadata and matches determine.

    Attributes:
        poses: world from camera (3, 4) by photograph.
        cameras: as adjusted, or as they were.
        camera_of: index into `cameras` by photograph.
        points: the sparse points.
        sessions: the flights that the survey is made of.
        focal_length_rule: whether the focal length was held or free, and why.
        ground_points: surveyed points compared with the solution.
        sigma_scale: factor by which the positions' stated sigmas proved too small.
        refined: whether the poses differ from metadata's at all.
    """

    poses: Poses
    cameras: tuple[Camera, ...]
    camera_of: Mapping[int, int]
    points: SparsePoints
    sessions: tuple[Session, ...]
    focal_length_rule: str
    ground_points: tuple[GroundPoint, ...] = ()
    sigma_scale: float = 1.0
    refined: bool = False


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


def solve_from_metadata(found: Correspondences) -> Solution:
    """Keep metadata's poses and cameras, as the paper does, and triangulate with room for their errors."""
    flight = found.flight
    accepted = accepted_pixels(flight)[0]
    poses, camera_of = metadata_poses(flight), dict(enumerate(flight.camera_of))
    reconstruction = found.triangulate(found.lenses, poses, accepted)
    return Solution(
        poses=poses,
        cameras=flight.cameras,
        camera_of=camera_of,
        points=sparse_points(flight, reconstruction, accepted),
        ground_points=compare(found.targets, poses, flight.cameras, camera_of),
        sessions=found.sessions,
        focal_length_rule=found.freedom.rule,
    )


def solve_by_refinement(found: Correspondences) -> Solution:
    """Alternate triangulation and bundle adjustment with position priors, accepting less error in every round.

    The first round moves poses and points alone; from the second on, cameras adjust too, and photographs without a
    pose, or that nobody agrees with, are resected from the points of the others. Positions that the adjustment
    contradicts are left out of account, and sigmas raised that prove too small.

    Raises:
        InputError: fewer than three photographs can be registered.
    """
    flight, context = found.flight, found.context
    lenses, poses, trust = found.lenses, metadata_poses(flight), Trust()
    rounds = accepted_pixels(flight)
    for number, accepted in enumerate(rounds):
        reconstruction = found.triangulate(lenses, poses, accepted)
        require_enough(len(poses_of(reconstruction)), "that share enough detail with others", flight.folder)
        fixed = add_control(reconstruction, found.targets, found.target_rows) if number else []
        _adjust(found, reconstruction, HELD if number == 0 else found.freedom, accepted, fixed)
        if number == len(rounds) - 1:
            trust = _settle(found, reconstruction, accepted, fixed)
        poses = poses_of(reconstruction)
        if number == 0:
            seen = compare(found.targets, poses, flight.cameras, dict(enumerate(flight.camera_of)))
            require_one_datum(seen, np.median(flight.position_sigma, axis=0), str(flight.folder))
        for control in fixed:
            reconstruction.delete_point3D(control)
        lenses = [adjusted_lens(reconstruction, lens) for lens in lenses]
        if 0 < number < len(ACCEPTED_ANGLES):
            missing = [index for index in range(len(flight)) if index not in poses]
            poses |= resect(found.features, found.matches, reconstruction, lenses, flight, missing, context.seed)
        error = float(reconstruction.compute_mean_reprojection_error())
        context.progress(0.7 + 0.3 * (number + 1) / len(rounds), 1.0, reprojection_error_px=error)
    require_enough(len(poses), "that can be registered", flight.folder)
    warn_of_positions(flight, poses, trust, context)
    cameras, camera_of = tuple(camera_from_lens(lens) for lens in lenses), dict(enumerate(flight.camera_of))
    return Solution(
        poses=poses,
        cameras=cameras,
        camera_of=camera_of,
        points=sparse_points(flight, reconstruction, rounds[-1]),
        ground_points=compare(found.targets, poses, cameras, camera_of),
        sessions=found.sessions,
        focal_length_rule=found.freedom.rule,
        sigma_scale=trust.sigma_scale,
        refined=True,
    )


def _settle(
    found: Correspondences, reconstruction: "pycolmap.Reconstruction", accepted: float, fixed: list[int]
) -> Trust:
    """Adjust without the false positions, and with larger sigmas for as long as the stated ones prove too small.

    Sigmas are judged by an adjustment that holds to them: a looser one would drift off and confirm itself.
    """
    trust = Trust(distrusted=weigh(found.flight, poses_of(reconstruction)).distrusted)
    for _ in range(WEIGHINGS):
        _adjust(found, reconstruction, found.freedom, accepted, fixed, trust)
        weighed = weigh(found.flight, poses_of(reconstruction))
        if weighed.distrusted == trust.distrusted and weighed.sigma_scale <= SETTLED * trust.sigma_scale:
            return trust
        trust = Trust(max(weighed.sigma_scale, trust.sigma_scale), weighed.distrusted)
    return trust


def _adjust(
    found: Correspondences,
    reconstruction: "pycolmap.Reconstruction",
    freedom: Freedom,
    accepted: float,
    fixed: list[int],
    trust: Trust | None = None,
) -> None:
    """Adjust with all positions, wary of false ones, or with those that are trusted."""
    priors = priors_of(reconstruction, found.flight, trust or Trust())
    adjust(reconstruction, priors, freedom, accepted, found.context.seed, fixed, robust=trust is None)


def warn_of_unregistered(flight: Flight, solution: Solution, context: Context) -> None:
    """Name the photographs that have no pose."""
    lost = [record for index, record in enumerate(flight.records) if index not in solution.poses]
    if lost:
        context.warn(f"{len(lost)} of {len(flight)} photographs couldn't be registered and are left out: {names(lost)}")


def adjusted_lens(reconstruction: "pycolmap.Reconstruction", lens: "pycolmap.Camera") -> "pycolmap.Camera":
    """Return the lens as adjusted, or as it was if COLMAP left it out because nothing matches its photographs."""
    adjusted: pycolmap.Camera = (
        reconstruction.camera(lens.camera_id) if reconstruction.exists_camera(lens.camera_id) else lens
    )
    return adjusted
