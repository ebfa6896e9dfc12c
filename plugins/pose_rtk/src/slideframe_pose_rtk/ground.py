"""The level ground that a flight is taken to look at, before anything is known of the true one."""

from itertools import pairwise

import numpy as np

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
    """Return the median share of a picture's ground that the next one shows too; 1 where there are no pairs."""
    shares = [_shared(flight, one, other, footprint(flight, one, height, SAMPLES)) for one, other in pairs]
    return float(np.median(shares)) if shares else 1.0


def _shared(flight: Flight, one: int, other: int, points: Float64Array) -> float:
    """Return the share of a photograph's rays that meet ground which the other one shows, distortion neglected."""
    camera = flight.cameras[flight.camera_of[other]]
    right, down, ahead = ((points - flight.positions[other]) @ flight.rotations[other]).T
    ahead = np.where(ahead > 0, ahead, np.inf)
    column = camera.focal_x * right / ahead + camera.principal_x
    row = camera.focal_y * down / ahead + camera.principal_y
    inside = (ahead < np.inf) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return float(inside.sum()) / SAMPLES**2
