"""Which photographs to compare: those that look at the same ground from similar directions."""

from itertools import pairwise

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Camera
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.sessions import sessions_of

SAMPLES = 8  # rays per side of a picture that stand for its footprint
LEAST_HEIGHT = 5.0  # m above ground, where the metadata would put the camera lower, or tells nothing
LONGEST_RAY = 4.0  # heights above ground; farther away, an oblique picture shows too little detail to match

Pair = tuple[int, int]


def choose_pairs(flight: Flight, partners: int) -> list[Pair]:
    """Return pairs (first < second) in order, up to `partners` chosen by each photograph, and those taken in turn.

    The ground is taken as level at the median of the metadata's heights above take-off: good enough
    to rank partners. A photograph of unknown orientation chooses its nearest ones, twice as many. Photographs
    taken one after the other show the same ground even where a position is false.
    """
    score = shared_view(flight)
    distance = np.linalg.norm(flight.positions[:, None] - flight.positions[None], axis=-1)
    pairs: set[Pair] = set()
    for index in range(len(flight)):
        if flight.oriented[index]:
            order = np.lexsort((distance[index], -score[index]))
            chosen = [other for other in order if score[index, other] > 0][:partners]
        else:
            order = np.argsort(distance[index], kind="stable")
            chosen = [other for other in order if other != index][: 2 * partners]
        pairs.update((min(index, int(other)), max(index, int(other))) for other in chosen)
    for session in sessions_of(flight.records):
        pairs.update((min(one, other), max(one, other)) for one, other in pairwise(session.indices.tolist()))
    return sorted(pairs)


def shared_view(flight: Flight) -> Float64Array:
    """Return how well the second photograph suits the first, as (first, second).

    It is the share of the first's ground that the second sees too, times the cosine between their
    viewing directions; 0 on the diagonal and for unknown orientations.
    """
    count = len(flight)
    height = ground_height(flight)
    axes = flight.rotations[:, :, 2]
    score = np.zeros((count, count))
    for index in np.flatnonzero(flight.oriented):
        ground = _footprint(flight, int(index), height)
        for other in np.flatnonzero(flight.oriented):
            if other != index and len(ground):
                camera = flight.cameras[flight.camera_of[other]]
                seen = _sees(camera, flight.rotations[other], flight.positions[other], ground)
                score[index, other] = seen.mean() * max(0.0, float(axes[index] @ axes[other]))
    return score


def ground_height(flight: Flight) -> float:
    """Return the assumed height of the ground in the local frame, m."""
    heights = [
        position[2] - max(LEAST_HEIGHT, record.height_above_takeoff or 0.0)
        for record, position in zip(flight.records, flight.positions, strict=True)
    ]
    return float(min(np.median(heights), flight.positions[:, 2].min() - LEAST_HEIGHT))


def _footprint(flight: Flight, index: int, height: float) -> Float64Array:
    """Return (point, 3), m, where rays through a grid of pixels meet the ground nearby."""
    camera, position = flight.cameras[flight.camera_of[index]], flight.positions[index]
    columns = (np.arange(SAMPLES) + 0.5) / SAMPLES * camera.width - camera.principal_x
    rows = (np.arange(SAMPLES) + 0.5) / SAMPLES * camera.height - camera.principal_y
    x, y = np.meshgrid(columns / camera.focal_x, rows / camera.focal_y)
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) @ flight.rotations[index].T
    above = position[2] - height
    down = np.minimum(rays[:, 2], -1e-9)
    reach = above / -down
    near = reach * np.linalg.norm(rays, axis=1) < LONGEST_RAY * above
    points: Float64Array = position + reach[near, None] * rays[near]
    return points


def _sees(camera: Camera, rotation: Float64Array, position: Float64Array, points: Float64Array) -> np.ndarray:
    """Return (point,) whether a point lies within the picture, distortion neglected."""
    x, y, depth = ((points - position) @ rotation).T
    ahead = np.maximum(depth, 1e-9)
    column = camera.focal_x * x / ahead + camera.principal_x
    row = camera.focal_y * y / ahead + camera.principal_y
    inside: np.ndarray = (depth > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return inside
