"""Which features of two photographs show the same spot."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.stages import Context
from slideframe.store import digest
from slideframe_pose_rtk.features import Features, read_array_file, write_array_file
from slideframe_pose_rtk.pairs import Pair

if TYPE_CHECKING:
    import pycolmap

UNIT = 512.0**2  # COLMAP stores a descriptor of unit length as bytes, times 512
RATIO = 0.8  # Lowe 2004, section 7.1: the second best match must be farther by this factor
FARTHEST = 0.7  # rad between descriptors of one spot; COLMAP's experience
ROWS = 512  # similarities computed at once, to stay in cache
LEAST_MATCHES = 15  # fewer agree by chance

FORMAT = 1  # raised whenever what follows finds other matches for the same features

UInt32Array = npt.NDArray[np.uint32]
Matches = dict[Pair, UInt32Array]


def match_photographs(
    features: list[Features],
    lenses: "list[pycolmap.Camera]",
    pairs: list[Pair],
    shelf: Path,
    context: Context,
) -> Matches:
    """Return, for pairs that share a view, the matches that fit one camera motion; from the shelf where they lie there.

    `lenses` has one entry for each photograph.
    """
    matches: Matches = {}
    for done, (first, second) in enumerate(pairs):
        context.progress(done, len(pairs))
        key = _key(features[first], features[second], lenses[first], lenses[second], context.seed)
        known = read_array_file(shelf / f"{key}.npz")
        if known is None:
            inliers = _match_pair(features[first], features[second], lenses[first], lenses[second], context.seed)
            write_array_file(shelf / f"{key}.npz", {"inliers": inliers})
        else:
            inliers = known["inliers"].astype(np.uint32)
        if len(inliers) >= LEAST_MATCHES:
            matches[first, second] = inliers
    return matches


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


def _angle(similarity: npt.NDArray[np.float32]) -> Float64Array:
    """Return the angle between descriptors, rad, in double precision: near 0, float32 has steps of 5e-4 rad."""
    angle: Float64Array = np.arccos(np.minimum(similarity.astype(np.float64) / UNIT, 1.0))
    return angle


def _match_pair(
    first: Features, second: Features, first_lens: "pycolmap.Camera", second_lens: "pycolmap.Camera", seed: int
) -> UInt32Array:
    """Return the (match, 2) indices of features on which one camera motion agrees."""
    import pycolmap

    matches = match_descriptors(first.descriptors, second.descriptors)
    if len(matches) < LEAST_MATCHES:
        return np.empty((0, 2), np.uint32)
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = seed
    geometry = pycolmap.estimate_two_view_geometry(
        first_lens, _points(first), second_lens, _points(second), matches, options
    )
    return np.array(geometry.inlier_matches, np.uint32).reshape(-1, 2)


def _points(features: Features) -> Float64Array:
    return features.keypoints[:, :2].astype(np.float64)


def _key(
    first: Features, second: Features, first_lens: "pycolmap.Camera", second_lens: "pycolmap.Camera", seed: int
) -> str:
    lenses = [[str(lens.model), *map(float, lens.params)] for lens in (first_lens, second_lens)]
    return digest(["matches", FORMAT, first.key, second.key, lenses, seed])
