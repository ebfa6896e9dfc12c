"""Poses, cameras and sparse points: as metadata gives them, or refined."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slideframe.products import Camera, GroundPoint, PoseOrigin
from slideframe.quality.pictures import PictureQuality
from slideframe.stages import Context
from slideframe_pose_rtk.adjustment import (
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
from slideframe_pose_rtk.levelling import levelling
from slideframe_pose_rtk.naming import names
from slideframe_pose_rtk.offsets import by_trust, centre_offsets, ground_offsets, moved, warn_of_offsets
from slideframe_pose_rtk.placing import poses_from_metadata
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
        principal_point_rule: the same of the principal point.
        ground_points: surveyed points compared with the solution.
        sigma_scale: factor by which the positions' stated sigmas proved too small.
        origin: where the poses come from.
        from_metadata: photographs whose pose is metadata's all the same, without their flight's bias.
    """

    poses: Poses
    cameras: tuple[Camera, ...]
    camera_of: Mapping[int, int]
    points: SparsePoints
    sessions: tuple[Session, ...]
    focal_length_rule: str
    principal_point_rule: str
    ground_points: tuple[GroundPoint, ...] = ()
    sigma_scale: float = 1.0
    origin: PoseOrigin = "metadata"
    from_metadata: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Views:
    """What is known so far: world from camera (3, 4) by photograph, and COLMAP's camera by index."""

    poses: Poses
    lenses: "list[pycolmap.Camera]"


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
        focal_length_rule=found.freedom.focal_length_rule,
        principal_point_rule=found.freedom.principal_point_rule,
    )


def solve_by_refinement(found: Correspondences) -> Solution:
    """Alternate triangulation and bundle adjustment with position priors, accepting less error in every round.

    The first round moves poses and points alone; from the second on, cameras adjust too, and photographs without a
    pose, or that nobody agrees with, are resected from the points of the others. Positions that the adjustment
    contradicts are left out of account, and sigmas raised that prove too small.

    Raises:
        InputError: fewer than three photographs can be registered.
    """
    context, stated = found.context, found.flight
    found = _with_one_datum(found)
    views, rounds = Views(metadata_poses(found.flight), list(found.lenses)), accepted_pixels(found.flight)
    for number, accepted in enumerate(rounds):
        is_first, is_last = number == 0, number == len(rounds) - 1
        reconstruction = found.triangulate(views.lenses, views.poses, accepted)
        require_enough(len(poses_of(reconstruction)), "that share enough detail with others", found.flight.folder)
        fixed = [] if is_first else add_control(reconstruction, found.targets, found.target_rows)
        _adjust(found, reconstruction, HELD if is_first else found.freedom, accepted, fixed)
        if is_last:
            found, trust = _concluded(found, reconstruction, accepted, fixed)
        views = Views(poses_of(reconstruction), [adjusted_lens(reconstruction, lens) for lens in views.lenses])
        for control in fixed:
            reconstruction.delete_point3D(control)
        if is_first:
            _require_one_datum(found, views.poses)
        elif not is_last:
            found, views = _with_resected(found, reconstruction, views)
        error = float(reconstruction.compute_mean_reprojection_error())
        context.progress(0.7 + 0.3 * (number + 1) / len(rounds), 1.0, reprojection_error_px=error)
    flight, poses = found.flight, views.poses
    require_enough(len(poses), "that can be registered", flight.folder)
    warn_of_offsets(stated, flight, found.sessions, context)
    warn_of_positions(flight, poses, trust, context)
    cameras, camera_of = tuple(camera_from_lens(lens) for lens in views.lenses), dict(enumerate(flight.camera_of))
    return Solution(
        poses=poses,
        cameras=cameras,
        camera_of=camera_of,
        points=sparse_points(flight, reconstruction, rounds[-1]),
        ground_points=compare(found.targets, poses, cameras, camera_of),
        sessions=found.sessions,
        focal_length_rule=found.freedom.focal_length_rule,
        principal_point_rule=found.freedom.principal_point_rule,
        sigma_scale=trust.sigma_scale,
        origin="adjusted",
    )


def _concluded(
    found: Correspondences, reconstruction: "pycolmap.Reconstruction", accepted: float, fixed: list[int]
) -> tuple[Correspondences, Trust]:
    """Settle which positions count and how much, bring flights on one datum, and level what they leave open."""
    flight = found.flight
    flight = moved(flight, centre_offsets(flight, poses_of(reconstruction), by_trust(flight, found.sessions)))
    found = dataclasses.replace(found, flight=flight)
    trust = _settle(found, reconstruction, accepted, fixed)
    level = None if fixed else levelling(flight, poses_of(reconstruction), trust, found.context)
    if level is not None:
        reconstruction.transform(level)
    return found, trust


def _require_one_datum(found: Correspondences, poses: Poses) -> None:
    """Refuse surveyed points on another level or in another system than the positions."""
    flight = found.flight
    seen = compare(found.targets, poses, flight.cameras, dict(enumerate(flight.camera_of)))
    require_one_datum(seen, np.median(flight.position_sigma, axis=0), str(flight.folder))


def _with_resected(
    found: Correspondences, reconstruction: "pycolmap.Reconstruction", views: Views
) -> tuple[Correspondences, Views]:
    """Add photographs without a pose by the points of the others; those that were turned get their lens turned."""
    flight, poses = found.flight, views.poses
    missing = [index for index in range(len(flight)) if index not in poses]
    placed = resect(found.features, found.matches, reconstruction, views.lenses, flight, missing, found.context.seed)
    views = Views(poses | placed, views.lenses)
    return found.with_turned_pictures(views.poses, views.lenses), views


def _with_one_datum(found: Correspondences) -> Correspondences:
    """Return the same with flights moved whose positions lie apart from those of the best flight as a whole.

    Each flight's points are found from its own photographs, at metadata's poses, adjusted with their positions.
    """
    flight, sessions = found.flight, by_trust(found.flight, found.sessions)
    if len(sessions) < 2:
        return found
    accepted, poses = accepted_pixels(flight)[0], metadata_poses(flight)
    blocks = []
    for session in sessions:
        own = {index: poses[index] for index in session.indices.tolist() if index in poses}
        block = found.triangulate(found.lenses, own, accepted)
        if block.num_points3D():
            _adjust(found, block, HELD, accepted, [])
            blocks.append((session, block))
    if len(blocks) < 2:
        return found
    return dataclasses.replace(found, flight=moved(flight, ground_offsets(flight, blocks, found.matches)))


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


def with_unregistered(
    flight: Flight, solution: Solution, qualities: Sequence[PictureQuality | None], context: Context
) -> Solution:
    """Return the solution with the photographs that it lacks where metadata put them, unless they show nothing."""
    missing = [
        index
        for index, quality in enumerate(qualities)
        if index not in solution.poses and quality is not None and quality.fault is None
    ]
    placed, error = poses_from_metadata(flight, solution.poses, solution.sessions, missing)
    if placed:
        pixels = max(solution.cameras[solution.camera_of[index]].focal_x for index in placed) * np.radians(error)
        context.warn(
            f"{len(placed)} of {len(flight)} photographs couldn't be registered and are placed by their metadata,"
            f" without their flight's bias; that is off by {error:.1f} degrees on the others (median; {pixels:.0f} px):"
            f" {names([flight.records[index] for index in sorted(placed)])}"
        )
    return dataclasses.replace(solution, poses=solution.poses | placed, from_metadata=frozenset(placed))


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
