"""Flights whose positions lie apart as a whole: another base station, another datum, a wrong fix."""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.quality.appraisal import LEAST_OUTLIER, OUTLIER_SIGMAS
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.matching import Matches
from slideframe_pose_rtk.sessions import Session

if TYPE_CHECKING:
    import pycolmap

FEWEST_SPOTS = 30  # seen by both flights
LEAST_OF_FLIGHT = 3  # photographs
# What else sets the ground of two flights apart: a lens or gimbal off by a degree, and a focal length off by 5 %.
TILT_SHARE, HEIGHT_SHARE = 0.02, 0.05  # of the flying height, and of what the flights' heights differ by

Offset = tuple[Session, Float64Array]


def ground_offsets(
    flight: Flight, blocks: "Sequence[tuple[Session, pycolmap.Reconstruction]]", matches: Matches
) -> list[Offset]:
    """Return how far each flight's positions must be moved (3,), m, for its ground to lie where the first one's does.

    Every block holds the points of one flight alone; spots that are matched across flights then have two places,
    whose median difference is the offset. Those that a lens or a gimbal may cause are left to the adjustment.
    """
    (reference, first), *others = blocks
    found = []
    for session, block in others:
        differences = _differences(first, block, matches)
        if len(differences) < FEWEST_SPOTS:
            continue
        offset = np.median(differences, axis=0)
        heights = [
            float(np.median(flight.positions[part.indices, 2])) - float(np.median(_heights(points)))
            for part, points in ((reference, first), (session, block))
        ]
        sigma = np.linalg.norm([np.median(flight.position_sigma[part.indices]) for part in (reference, session)])
        allowed = TILT_SHARE * max(heights) + HEIGHT_SHARE * abs(heights[0] - heights[1]) + OUTLIER_SIGMAS * sigma
        if np.abs(offset).max() > allowed:
            found.append((session, offset))
    return found


def centre_offsets(flight: Flight, poses: Poses, sessions: Sequence[Session]) -> list[Offset]:
    """Return the same from adjusted centres: by how much the flights' residuals differ from the first one's."""
    residuals = []
    for session in sessions:
        known = [index for index in session.indices.tolist() if index in poses]
        if len(known) >= LEAST_OF_FLIGHT:
            centres = np.array([poses[index][:, 3] for index in known])
            sigma = flight.position_sigma[known].mean(axis=0) / np.sqrt(len(known))
            residuals.append((session, np.median(centres - flight.positions[known], axis=0), sigma))
    found = []
    for session, median, sigma in residuals[1:]:
        offset = median - residuals[0][1]
        if (np.abs(offset) > np.maximum(OUTLIER_SIGMAS * np.hypot(sigma, residuals[0][2]), LEAST_OUTLIER)).any():
            found.append((session, offset))
    return found


def moved(flight: Flight, offsets: Sequence[Offset]) -> Flight:
    """Return the flight with positions moved."""
    positions = flight.positions.copy()
    for session, offset in offsets:
        positions[session.indices] += offset
    return dataclasses.replace(flight, positions=positions)


def by_trust(flight: Flight, sessions: Sequence[Session]) -> list[Session]:
    """Return the flights of three photographs and more, the one with the best positions, then the longest, first."""
    large = [session for session in sessions if len(session.indices) >= LEAST_OF_FLIGHT]
    return sorted(
        large,
        key=lambda session: (round(float(np.median(flight.position_sigma[session.indices])), 2), -len(session.indices)),
    )


def warn_of_offsets(before: Flight, after: Flight, sessions: Sequence[Session], context: Context) -> None:
    """State by how much the positions of which flights were moved."""
    for session in sessions:
        east, north, up = np.median(after.positions[session.indices] - before.positions[session.indices], axis=0)
        if max(abs(east), abs(north), abs(up)) > 0:
            context.warn(
                f"the positions of {session.name} ({len(session.indices)} photographs) are moved by {east:+.2f},"
                f" {north:+.2f}, {up:+.2f} m (east, north, up), for its photographs show the same ground as"
                f" {by_trust(before, sessions)[0].name}'s elsewhere: one of the two has another base station or datum"
            )


def _heights(block: "pycolmap.Reconstruction") -> Float64Array:
    return np.array([point.xyz[2] for point in block.points3D.values()], np.float64)


def _differences(first: "pycolmap.Reconstruction", second: "pycolmap.Reconstruction", matches: Matches) -> Float64Array:
    """Return (spot, 3), m, first minus second place of the spots that photographs of both show."""
    found = []
    for (one, other), pair in sorted(matches.items()):
        for mine, theirs, columns in ((one, other, pair), (other, one, pair[:, ::-1])):
            if not (_has(first, mine) and _has(second, theirs)):
                continue
            images = first.image(mine + 1), second.image(theirs + 1)
            for row in columns:
                points = [image.point2D(int(number)) for image, number in zip(images, row, strict=True)]
                if all(point.has_point3D() for point in points):
                    places = [block.point3D(p.point3D_id).xyz for block, p in zip((first, second), points, strict=True)]
                    found.append(places[0] - places[1])
    return np.array(found, np.float64).reshape(-1, 3)


def _has(block: "pycolmap.Reconstruction", index: int) -> bool:
    return block.exists_image(index + 1) and block.image(index + 1).has_pose
