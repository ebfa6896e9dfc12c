"""How far a flight's headings are off, told by its matches before anything is adjusted."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.stages import Context
from slideframe_pose_rtk.features import Features
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.matching import Matches, UInt32Array
from slideframe_pose_rtk.orientation import about_up
from slideframe_pose_rtk.sessions import Session

if TYPE_CHECKING:
    import pycolmap

# Compasses of real flights are off by up to 2.5 degrees (Mirafiori and four more), which adjustment takes in its
# stride; it begins by accepting 6 degrees, pitch and roll included.
LARGEST_USUAL = 4.0  # degrees
# Pairs flown in one direction agree to a few degrees; where they scatter more, nothing can be concluded.
LARGEST_SCATTER = 12.0  # degrees, median absolute deviation
FEWEST_PAIRS = 5
SAMPLED_MATCHES = 200
LEAST_BASELINE = 1.0  # m
SIGMAS = 10.0  # a base line must exceed so many of the positions' sigmas for its direction to be known to 6 degrees
REWEIGHTINGS = 5
ALIKE = float(np.cos(np.radians(30.0)))  # views in different directions show the gimbal's errors, not the compass's


@dataclass(frozen=True)
class HeadingOffset:
    """The turn about the vertical, degrees counter-clockwise, that carries a flight's headings to its matches."""

    session: Session
    degrees: float
    scatter: float
    pair_count: int

    @property
    def is_certain(self) -> bool:
        """Whether the pairs agree."""
        return self.pair_count >= FEWEST_PAIRS and self.scatter <= LARGEST_SCATTER

    @property
    def is_unusual(self) -> bool:
        """Whether it's more than a compass error."""
        return self.is_certain and abs(self.degrees) > LARGEST_USUAL


def heading_offsets(
    flight: Flight,
    lenses: "Sequence[pycolmap.Camera]",
    features: Sequence[Features],
    matches: Matches,
    sessions: Sequence[Session],
) -> list[HeadingOffset]:
    """Compare, pair by pair within each session, where the matches and where the positions say that the drone flew.

    A turn that is common to both photographs of a pair leaves their relative rotation as it is, and turns the
    direction of motion that the matches show: the azimuth between it and the base line is the heading's error.
    """
    session_of = {int(index): number for number, session in enumerate(sessions) for index in session.indices}
    offsets: dict[int, list[float]] = {number: [] for number in range(len(sessions))}
    for (first, second), pair in sorted(matches.items()):
        if session_of[first] == session_of[second] and _is_telling(flight, first, second):
            motion = _motion(flight, lenses, features, first, second, pair)
            base = flight.positions[second] - flight.positions[first]
            offsets[session_of[first]].append(_azimuth(base) - _azimuth(motion))
    return [_summary(session, np.array(offsets[number])) for number, session in enumerate(sessions)]


def turn_headings(flight: Flight, offsets: Sequence[HeadingOffset]) -> Flight:
    """Return the flight with the headings of unusual offsets set right."""
    rotations = flight.rotations.copy()
    for offset in offsets:
        if offset.is_unusual:
            rotations[offset.session.indices] = about_up(offset.degrees) @ rotations[offset.session.indices]
    return dataclasses.replace(flight, rotations=rotations)


def warn_of_headings(offsets: Sequence[HeadingOffset], corrected: bool, context: Context) -> None:
    """State which flights' headings are off by more than a compass error."""
    for offset in offsets:
        if offset.is_unusual:
            done = "they are turned by it" if corrected else "refine = false keeps them: expect a useless result"
            context.warn(
                f"the headings of {offset.session.name} ({len(offset.session.indices)} photographs) are off by"
                f" {offset.degrees:+.0f} degrees, say {offset.pair_count} pairs of photographs; {done}"
            )


def _is_telling(flight: Flight, first: int, second: int) -> bool:
    base = flight.positions[second] - flight.positions[first]
    across = float(np.hypot(base[0], base[1]))
    doubt = float(np.hypot(flight.position_sigma[first, :2].max(), flight.position_sigma[second, :2].max()))
    known = bool(flight.oriented[first] and flight.oriented[second])
    alike = np.trace(flight.rotations[first].T @ flight.rotations[second]) > 1 + 2 * ALIKE
    return known and bool(alike) and across > max(LEAST_BASELINE, SIGMAS * doubt) and across > abs(base[2])


def _motion(
    flight: Flight,
    lenses: "Sequence[pycolmap.Camera]",
    features: Sequence[Features],
    first: int,
    second: int,
    pair: UInt32Array,
) -> Float64Array:
    """Return the direction from the first camera to the second, with the metadata's rotations.

    It is at right angles to every normal of an epipolar plane: the direction of least sum of squares, reweighted
    so that false matches don't pull, of the sign that puts the points before the cameras.
    """
    chosen = pair[np.linspace(0, len(pair) - 1, min(len(pair), SAMPLED_MATCHES)).astype(int)]
    rays = [
        _rays(lenses[index], features[index], chosen[:, side]) @ flight.rotations[index].T
        for side, index in enumerate((first, second))
    ]
    normals = np.cross(rays[0], rays[1])
    weights = np.ones(len(normals))
    for _ in range(REWEIGHTINGS):
        direction = np.linalg.eigh(normals.T @ (weights[:, None] * normals))[1][:, 0]
        miss = np.abs(normals @ direction)
        weights = 1 / (1 + (miss / max(float(np.median(miss)), 1e-9)) ** 2)
    depth = np.einsum("ij,ij->i", np.cross(np.broadcast_to(direction, rays[1].shape), rays[1]), normals)
    motion: Float64Array = direction * (1 if np.median(depth) > 0 else -1)
    return motion


def _rays(lens: "pycolmap.Camera", features: Features, chosen: UInt32Array) -> Float64Array:
    slopes = np.asarray(lens.cam_from_img(features.keypoints[chosen, :2].astype(np.float64)))
    rays = np.column_stack([slopes, np.ones(len(slopes))])
    unit: Float64Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _azimuth(direction: Float64Array) -> float:
    """Return the angle from east, counter-clockwise, degrees."""
    return float(np.degrees(np.arctan2(direction[1], direction[0])))


def _summary(session: Session, offsets: Float64Array) -> HeadingOffset:
    """Return the median on the circle, about the direction of the mean, and the median deviation from it."""
    if not len(offsets):
        return HeadingOffset(session, 0.0, 180.0, 0)
    angles = np.radians(offsets)
    centre = np.degrees(np.arctan2(np.median(np.sin(angles)), np.median(np.cos(angles))))
    around = (offsets - centre + 180.0) % 360.0 - 180.0
    middle = float(np.median(around))
    degrees = float((centre + middle + 180.0) % 360.0 - 180.0)
    return HeadingOffset(session, degrees, float(np.median(np.abs(around - middle))), len(offsets))
