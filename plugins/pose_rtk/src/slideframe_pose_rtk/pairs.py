"""Which photographs to compare: those that look at the same ground from similar directions."""

from itertools import pairwise

import numpy as np

from slideframe.arrays import Float64Array
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.ground import footprint, ground_height, in_picture, lenses_of
from slideframe_pose_rtk.sessions import sessions_of

SAMPLES = 8  # rays per side of a picture that stand for its footprint

Pair = tuple[int, int]


def choose_pairs(flight: Flight, partners: int) -> list[Pair]:
    """Return pairs (first < second) in order, up to `partners` chosen by each photograph, and those taken in turn.

    The ground is taken as level, which is good enough to rank partners. They are taken from all four sides first,
    because along a strip alone there may be more good ones than `partners`, and strips would hang together by nothing.
    A photograph of unknown orientation chooses its nearest ones, twice as many. Photographs taken one after the other
    show the same ground even where a position is false.
    """
    score = shared_view(flight)
    distance = np.linalg.norm(flight.positions[:, None] - flight.positions[None], axis=-1)
    pairs: set[Pair] = set()
    for index in range(len(flight)):
        if flight.oriented[index]:
            order = np.lexsort((distance[index], -score[index]))
            good = order[score[index, order] > 0]
            chosen = _from_all_sides(good, flight.positions[good] - flight.positions[index], partners)
        else:
            order = np.argsort(distance[index], kind="stable")
            chosen = [int(other) for other in order if other != index][: 2 * partners]
        pairs.update((min(index, other), max(index, other)) for other in chosen)
    for session in sessions_of(flight.records):
        pairs.update((min(one, other), max(one, other)) for one, other in pairwise(session.indices.tolist()))
    return sorted(pairs)


def _from_all_sides(ranked: np.ndarray, offsets: Float64Array, most: int) -> list[int]:
    """Return the best of those ranked: an eighth of `most` from each quarter of the horizon, then whoever is next."""
    quarter = np.floor(np.arctan2(offsets[:, 1], offsets[:, 0]) / (np.pi / 2) + 0.5).astype(int) % 4
    first = np.concatenate([np.flatnonzero(quarter == side)[: max(1, most // 8)] for side in range(4)])
    rest = np.setdiff1d(np.arange(len(ranked)), first)
    return [int(other) for other in ranked[np.concatenate([np.sort(first), rest])[:most]]]


def shared_view(flight: Flight) -> Float64Array:
    """Return how well the second photograph suits the first, as (first, second).

    It is the share of the first's ground that the second sees too, times the cosine between their
    viewing directions; 0 on the diagonal and for unknown orientations.
    """
    count = len(flight)
    height = ground_height(flight)
    axes = flight.rotations[:, :, 2]
    everyone, lenses = np.arange(count), lenses_of(flight)
    score = np.zeros((count, count))
    for index in np.flatnonzero(flight.oriented):
        ground = footprint(flight, int(index), height, SAMPLES)
        if len(ground):
            seen = in_picture(flight, everyone, lenses, ground).mean(axis=1)
            score[index] = seen * np.maximum(0.0, axes @ axes[index])
    score[:, ~flight.oriented] = 0.0
    np.fill_diagonal(score, 0.0)
    return score
