"""What of the cameras the adjustment may change, and why."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.lens import adjustable_lens, exact_lens, pinhole_lens
from slideframe_pose_rtk.pairs import ground_height

if TYPE_CHECKING:
    import pycolmap

FocalLength = Literal["auto", "held", "free"]

# Nadir views from one height fit any focal length, trading it for height (measured: 1913 to 2470 px at equal error).
OBLIQUE_ANGLE = 15.0  # degrees off nadir
OBLIQUE_SHARE = 0.25
HEIGHT_SPREAD = 0.2  # of the flying height
ENOUGH_CONTROL = 3  # control points
# A false principal point moves every centre across its view by H / f. Positions tell that from their noise, and from a
# shift of all the ground, only where views are turned against one another: strips flown to and fro.
PRINCIPAL_POINT_SIGMA = 0.5  # px; about what a view's own points leave open
LEAST_FOR_CALIBRATION = 8  # photographs of one camera; fewer leave its distortion to chance


@dataclass(frozen=True)
class Freedom:
    """What of the cameras the adjustment may change, and why; `held` cameras (indices) stay as they are."""

    focal_length: bool
    principal_point: bool
    distortion: bool
    held: frozenset[int] = frozenset()
    focal_length_rule: str = ""
    principal_point_rule: str = ""


KEPT = "held: metadata's cameras are kept as they are"
HELD = Freedom(
    focal_length=False,
    principal_point=False,
    distortion=False,
    focal_length_rule=KEPT,
    principal_point_rule=KEPT,
)


def choose_freedom(flight: Flight, focal_length: FocalLength, control_count: int = 0) -> Freedom:
    """Free focal length and principal point only where the flight determines each, unless the user decides."""
    free, rule = (focal_length == "free", "as asked for")
    if focal_length == "auto":
        free, rule = _focal_length_rule(flight, control_count)
    centre_free, centre_rule = free, rule
    counts = np.bincount(flight.camera_of, minlength=len(flight.cameras))
    held = frozenset(int(camera) for camera in np.flatnonzero(counts < LEAST_FOR_CALIBRATION))
    if len(held) == len(flight.cameras):
        free = centre_free = False
        rule = centre_rule = f"no camera took {LEAST_FOR_CALIBRATION} photographs"
    elif focal_length == "auto" and not free:
        centre_free, centre_rule = _principal_point_rule(flight, held)
    return Freedom(
        focal_length=free,
        principal_point=centre_free,
        distortion=True,
        held=held,
        focal_length_rule=f"{'free' if free else 'held'}: {rule}",
        principal_point_rule=f"{'free' if centre_free else 'held'}: {centre_rule}",
    )


def lenses_of(flight: Flight, freedom: Freedom) -> "list[pycolmap.Camera]":
    """Return COLMAP's cameras, numbered from 1: exact where they stay as they are, else in models that adjust well."""
    dewarped = {camera for camera, record in zip(flight.camera_of, flight.records, strict=True) if record.is_dewarped}
    lenses = []
    for index, camera in enumerate(flight.cameras):
        if index in freedom.held or not freedom.distortion:
            lenses.append(exact_lens(camera, index + 1))
        elif index in dewarped:
            lenses.append(pinhole_lens(camera, index + 1))
        else:
            lenses.append(adjustable_lens(camera, index + 1))
    return lenses


def _focal_length_rule(flight: Flight, control_count: int) -> tuple[bool, str]:
    """Tell whether something determines the focal length, and how that was seen."""
    oblique, spread = _oblique_share(flight), _height_spread(flight)
    if oblique >= OBLIQUE_SHARE:
        return True, f"{oblique:.0%} of the views are oblique"
    if spread >= HEIGHT_SPREAD:
        return True, f"flying heights differ by {spread:.0%}"
    if control_count >= ENOUGH_CONTROL:
        return True, f"{control_count} control points determine it"
    return False, f"only {oblique:.0%} of the views are oblique and heights differ by {spread:.0%}: any value would fit"


def _principal_point_rule(flight: Flight, held: frozenset[int]) -> tuple[bool, str]:
    """Tell whether the positions determine where the lenses' axes meet the pictures."""
    sigma = max(_principal_point_sigma(flight, camera) for camera in range(len(flight.cameras)) if camera not in held)
    if sigma <= PRINCIPAL_POINT_SIGMA:
        return True, f"views turned against one another determine it to {sigma:.1f} px"
    return False, "the positions of views turned alike" + (
        " leave it open" if not np.isfinite(sigma) else f" leave it open to {sigma:.0f} px"
    )


def _principal_point_sigma(flight: Flight, camera: int) -> float:
    """Return how well the positions determine a camera's principal point, px.

    An offset d moves centre i by d H / f, turned by its heading a_i. The ground follows what is common to all, so
    that sum |exp(i a) - mean|^2 = n (1 - R^2) remains of n equations, each of deviation sigma f / H.
    """
    chosen = np.flatnonzero((np.array(flight.camera_of) == camera) & flight.oriented)
    if not len(chosen):
        return np.inf
    across = flight.rotations[chosen][:, :2, 0]  # the pictures' rows, on the ground
    remaining = float((across**2).sum() - (across.sum(axis=0) ** 2).sum() / len(chosen))
    height = float(np.median(flight.positions[chosen, 2])) - ground_height(flight)
    pixels = flight.position_sigma[chosen, :2].mean() * flight.cameras[camera].focal_x / height
    return float(pixels / np.sqrt(max(remaining, 1e-12)))


def _oblique_share(flight: Flight) -> float:
    downward = -flight.rotations[flight.oriented][:, 2, 2]
    return float(np.mean(downward < np.cos(np.radians(OBLIQUE_ANGLE)))) if len(downward) else 0.0


def _height_spread(flight: Flight) -> float:
    heights = flight.positions[:, 2] - ground_height(flight)
    return float(np.ptp(heights) / np.median(heights))
