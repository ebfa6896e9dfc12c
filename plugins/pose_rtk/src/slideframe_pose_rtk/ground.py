"""The level ground that a flight is taken to look at, before anything is known of the true one."""

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.sessions import sessions_of

LEAST_HEIGHT = 5.0  # m above ground, where the metadata would put the camera lower
LONGEST_RAY = 4.0  # heights above ground; farther away, an oblique picture shows too little detail to match
# Mapping flights have 60 to 85 % of a picture in common with the next; what shares less than a third can't be matched.
USUAL_OVERLAP = 0.7
LEAST_OVERLAP = 0.3
RISE = 1.15  # from one height that is tried to the next
HIGHEST = 1000.0  # m
MEETING = 0.97  # of the largest overlap and more: where views meet
MOST_PAIRS = 40  # evenly chosen, whose overlap is tried
SAMPLES = 6  # rays per side of a picture


def ground_height(flight: Flight) -> float:
    """Return the assumed height of the ground in the local frame, m.

    It is the median by the heights above take-off. Files without XMP state none, and take-off from a hill-top or from a
    valley makes them useless: where photographs taken one after the other would hardly share any ground, it is put
    where their overlap is that of a flight that maps.
    """
    stated = [
        position[2] - max(LEAST_HEIGHT, record.height_above_takeoff)
        for record, position in zip(flight.records, flight.positions, strict=True)
        if record.height_above_takeoff is not None
    ]
    highest = float(flight.positions[:, 2].min()) - LEAST_HEIGHT
    pairs = _consecutive(flight)
    if stated:
        height = min(float(np.median(stated)), highest)
        return height if _overlap(flight, pairs, height) >= LEAST_OVERLAP else _by_overlap(flight, pairs, height)
    return _by_overlap(flight, pairs, highest)


def footprint(flight: Flight, index: int, height: float, samples: int) -> Float64Array:
    """Return (point, 3), m, where rays through a grid of pixels, so many a side, meet level ground nearby."""
    camera, position = flight.cameras[flight.camera_of[index]], flight.positions[index]
    columns = (np.arange(samples) + 0.5) / samples * camera.width - camera.principal_x
    rows = (np.arange(samples) + 0.5) / samples * camera.height - camera.principal_y
    x, y = np.meshgrid(columns / camera.focal_x, rows / camera.focal_y)
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) @ flight.rotations[index].T
    above = position[2] - height
    down = np.minimum(rays[:, 2], -1e-9)
    reach = above / -down
    near = reach * np.linalg.norm(rays, axis=1) < LONGEST_RAY * above
    points: Float64Array = position + reach[near, None] * rays[near]
    return points


def lenses_of(flight: Flight) -> Float64Array:
    """Return focal lengths, principal point and size (photograph, 6), px."""
    rows = [
        (camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y, camera.width, camera.height)
        for camera in flight.cameras
    ]
    return np.array(rows, np.float64)[list(flight.camera_of)]


def in_picture(
    flight: Flight, photographs: npt.NDArray[np.int64], lenses: Float64Array, points: Float64Array
) -> npt.NDArray[np.bool_]:
    """Tell which points (point, 3) the chosen photographs show (photograph, point), distortion neglected.

    `lenses` are those of all photographs, see `lenses_of`.
    """
    in_camera = np.matmul(points[None] - flight.positions[photographs, None], flight.rotations[photographs])
    ahead = np.maximum(in_camera[:, :, 2], 1e-9)
    focal_x, focal_y, principal_x, principal_y, width, height = lenses[photographs].T[:, :, None]
    column = focal_x * in_camera[:, :, 0] / ahead + principal_x
    row = focal_y * in_camera[:, :, 1] / ahead + principal_y
    inside: npt.NDArray[np.bool_] = (
        (in_camera[:, :, 2] > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    )
    return inside


def _by_overlap(flight: Flight, pairs: list[tuple[int, int]], highest: float) -> float:
    """Return the height, at `highest` or below, that overlap speaks for.

    Along parallel views overlap grows the farther the ground is away: its usual share tells where. Views that meet, as
    of an orbit, share the most where they do.
    """
    if not pairs:
        return highest
    top = float(flight.positions[:, 2].max())
    steps = np.arange(1 + np.ceil(np.log(max(HIGHEST / (top - highest), 1.0)) / np.log(RISE)))
    heights = top - (top - highest) * RISE**steps
    overlap = np.array([_overlap(flight, pairs, height) for height in heights])
    if overlap[-1] < MEETING * overlap.max():
        closest = np.flatnonzero(overlap >= MEETING * overlap.max())
        return float(heights[closest[len(closest) // 2]])
    return float(heights[np.argmax(overlap >= min(USUAL_OVERLAP, overlap.max()))])


def _consecutive(flight: Flight) -> list[tuple[int, int]]:
    """Return pairs of photographs with known angles, one taken after the other."""
    pairs = [
        pair
        for session in sessions_of(flight.records)
        for pair in pairwise(index for index in session.indices.tolist() if flight.oriented[index])
    ]
    chosen = np.linspace(0, len(pairs) - 1, min(len(pairs), MOST_PAIRS)).astype(int)
    return [pairs[number] for number in chosen]


def _overlap(flight: Flight, pairs: list[tuple[int, int]], height: float) -> float:
    """Return the median share of a picture's rays that meet ground which the next shows; 1 where there are no pairs."""
    lenses = lenses_of(flight)
    shares = [
        in_picture(flight, np.array([other]), lenses, footprint(flight, one, height, SAMPLES)).sum() / SAMPLES**2
        for one, other in pairs
    ]
    return float(np.median(shares)) if shares else 1.0
