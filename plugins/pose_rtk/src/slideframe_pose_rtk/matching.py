"""Which features of two photographs show the same spot."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.stages import Context
from slideframe_pose_rtk.pairs import Pair

if TYPE_CHECKING:
    import pycolmap

UNIT = 512.0**2  # COLMAP stores a descriptor of unit length as bytes, times 512
RATIO = 0.8  # Lowe 2004, section 7.1: the second best match must be farther by this factor
FARTHEST = 0.7  # rad between descriptors of one spot; COLMAP's experience
ROWS = 512  # similarities computed at once, to stay in cache
LEAST_MATCHES = 15  # fewer agree by chance

UInt32Array = npt.NDArray[np.uint32]


def match_photographs(database: "pycolmap.Database", pairs: list[Pair], seed: int, context: Context) -> int:
    """Match the features of every pair that the database doesn't hold yet, and keep those that fit one camera motion.

    Returns the number of pairs that share a view.
    """
    import pycolmap

    descriptors = {index: _descriptors(database, index) for pair in pairs for index in pair}
    points = {index: _points(database, index) for index in descriptors}
    lenses = {index: database.read_camera(database.read_image(index + 1).camera_id) for index in descriptors}
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = seed
    for done, (first, second) in enumerate(pairs):
        context.progress(done, len(pairs))
        if database.exists_two_view_geometry(first + 1, second + 1):
            continue
        matches = match_descriptors(descriptors[first], descriptors[second])
        geometry = pycolmap.TwoViewGeometry()
        if len(matches) >= LEAST_MATCHES:
            geometry = pycolmap.estimate_two_view_geometry(
                lenses[first], points[first], lenses[second], points[second], matches, options
            )
        database.write_two_view_geometry(first + 1, second + 1, geometry)
    _, inlier_counts = database.read_two_view_geometry_num_inliers()
    return sum(count >= LEAST_MATCHES for count in inlier_counts)


def match_descriptors(first: UInt8Array, second: UInt8Array) -> UInt32Array:
    """Return (match, 2) indices of mutually best descriptors that pass Lowe's ratio test, by brute force.

    Descriptors (feature, 128) are whole numbers up to 255, of length 512: every partial sum of a dot product is a
    whole number below 2^24, so float32 is exact and the result doesn't depend on the order of summation.
    """
    if not len(first) or not len(second):
        return np.empty((0, 2), np.uint32)
    columns = np.ascontiguousarray(second.T, np.float32)
    best = np.empty(len(first), np.intp)
    similarity, runner_up = np.empty(len(first), np.float32), np.empty(len(first), np.float32)
    best_of_second = np.zeros(len(second), np.float32)
    for start in range(0, len(first), ROWS):
        block = first[start : start + ROWS].astype(np.float32) @ columns
        rows = np.arange(len(block))
        np.maximum(best_of_second, block.max(axis=0), out=best_of_second)
        best[start : start + ROWS] = block.argmax(axis=1)
        similarity[start : start + ROWS] = block[rows, best[start : start + ROWS]]
        block[rows, best[start : start + ROWS]] = 0.0
        runner_up[start : start + ROWS] = block.max(axis=1)
    mutual = similarity == best_of_second[best]
    distinct = (_angle(similarity) < RATIO * _angle(runner_up)) & (_angle(similarity) < FARTHEST)
    chosen = np.flatnonzero(mutual & distinct)
    _, unique = np.unique(best[chosen], return_index=True)  # equal descriptors would claim one spot twice
    chosen = chosen[np.sort(unique)]
    return np.column_stack([chosen, best[chosen]]).astype(np.uint32)


def _angle(similarity: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the angle between descriptors, rad."""
    angle: npt.NDArray[np.float32] = np.arccos(np.minimum(similarity / np.float32(UNIT), np.float32(1.0)))
    return angle


def _descriptors(database: "pycolmap.Database", index: int) -> UInt8Array:
    if not database.exists_descriptors(index + 1):
        return np.empty((0, 128), np.uint8)
    return np.array(database.read_descriptors(index + 1).data, np.uint8)


def _points(database: "pycolmap.Database", index: int) -> Float64Array:
    if not database.exists_keypoints(index + 1):
        return np.empty((0, 2), np.float64)
    return np.asarray(database.read_keypoints(index + 1), np.float64)[:, :2]
