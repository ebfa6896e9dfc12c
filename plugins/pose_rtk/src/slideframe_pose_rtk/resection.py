"""Poses of photographs that metadata couldn't place, from points that the others have found."""

from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe_pose_rtk.adjustment import LEAST_OBSERVATIONS
from slideframe_pose_rtk.features import Features
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.matching import Matches

if TYPE_CHECKING:
    import pycolmap

ACCEPTED_PIXELS = 12.0  # as COLMAP registers images, before any adjustment
FARTHEST_SIGMAS = 10.0  # from the metadata's position: beyond, the resection is a coincidence, or the position is false
LEAST_FARTHEST = 2.0  # m; a resected centre before adjustment is no better
# So many points, most of all that were matched, don't agree by coincidence: then it's the position that is false.
CONVINCING_POINTS = 100
CONVINCING_SHARE = 0.6


def resect(
    features: list[Features],
    matches: Matches,
    reconstruction: "pycolmap.Reconstruction",
    lenses: "list[pycolmap.Camera]",
    flight: Flight,
    missing: list[int],
    seed: int,
) -> Poses:
    """Return world from camera (3, 4) of those `missing` photographs whose matches determine it.

    A result is refused if it sees fewer than 30 points, or lies far from the metadata's position without strong
    reason.
    """
    import pycolmap

    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.random_seed = seed
    options.ransac.max_error = ACCEPTED_PIXELS
    poses = {}
    for index in missing:
        pixels, points = _sightings(features[index], matches, reconstruction, index)
        if len(pixels) < LEAST_OBSERVATIONS:
            continue
        lens = lenses[flight.camera_of[index]]
        found = pycolmap.estimate_and_refine_absolute_pose(pixels, points, lens, options)
        if found is not None and found["num_inliers"] >= LEAST_OBSERVATIONS:
            pose = np.array(found["cam_from_world"].inverse().matrix(), np.float64)
            convincing = found["num_inliers"] >= max(CONVINCING_POINTS, CONVINCING_SHARE * len(pixels))
            if convincing or _is_near(pose, flight, index):
                poses[index] = pose
    return poses


def _is_near(pose: Float64Array, flight: Flight, index: int) -> bool:
    offset = np.abs(pose[:, 3] - flight.positions[index])
    return bool((offset <= np.maximum(FARTHEST_SIGMAS * flight.position_sigma[index], LEAST_FARTHEST)).all())


def _sightings(
    features: Features, matches: Matches, reconstruction: "pycolmap.Reconstruction", index: int
) -> tuple[Float64Array, Float64Array]:
    """Return where photograph `index` shows points (sighting, 2), px, that its partners know (sighting, 3), m."""
    seen: dict[tuple[int, int], None] = {}
    for (first, second), pair in sorted(matches.items()):
        if index not in (first, second):
            continue
        partner_id = (second if index == first else first) + 1
        if not reconstruction.exists_image(partner_id):
            continue  # COLMAP leaves out what nothing matches
        partner = reconstruction.image(partner_id)
        for match in pair:
            mine, theirs = match if index == first else match[::-1]
            if partner.has_pose and partner.point2D(int(theirs)).has_point3D():
                seen[int(mine), int(partner.point2D(int(theirs)).point3D_id)] = None
    keypoints = features.keypoints.astype(np.float64)
    pixels = np.array([keypoints[mine, :2] for mine, _ in seen], np.float64).reshape(-1, 2)
    points = np.array([reconstruction.point3D(point).xyz for _, point in seen], np.float64).reshape(-1, 3)
    return pixels, points
