"""What of the cameras the adjustment may change, and why."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.ground import ground_height
from slideframe_pose_rtk.intrinsics import Calibration
from slideframe_pose_rtk.lens import adjustable_lens, exact_lens, pinhole_lens
from slideframe_pose_rtk.network import LensSigma, lens_sigma

if TYPE_CHECKING:
    import pycolmap

FocalLength = Literal["auto", "held", "free"]

# Nadir views from one height fit any focal length, trading it for height (measured: 1913 to 2470 px at equal error).
OBLIQUE_ANGLE = 15.0  # degrees off nadir
OBLIQUE_SHARE = 0.25
HEIGHT_SPREAD = 0.2  # of the flying height
ENOUGH_CONTROL = 3  # control points
LEAST_FOR_CALIBRATION = 8  # photographs of one camera; fewer leave its distortion to chance
# Optical centres lie within some percent of the width from the middle; what a flight determines ten times better is
# worth more than what the factory states.
PRINCIPAL_POINT_SHARE = 0.002  # of the width
# The focal length is known to some parts in a thousand where it was measured, to some percent where it wasn't.
FOCAL_LENGTH_SHARES: dict[Calibration, float] = {"user": 0.005, "measured": 0.005, "design": 0.01, "nominal": 0.03}
# m; worse heights would pass for several flying heights, where the barometer's don't
LARGEST_HEIGHT_SIGMA = 0.5
NOISE_SPREAD = 2 * 2.56  # between those percentiles of normal noise, twice over
OUTERMOST = (10.0, 90.0)  # percentiles: heights that one in ten photographs has


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
    centre_free, centre_rule = free, rule
    counts = np.bincount(flight.camera_of, minlength=len(flight.cameras))
    held = frozenset(int(camera) for camera in np.flatnonzero(counts < LEAST_FOR_CALIBRATION))
    if len(held) == len(flight.cameras):
        free = centre_free = False
        rule = centre_rule = f"no camera took {LEAST_FOR_CALIBRATION} photographs"
    elif focal_length == "auto":
        sigmas = {camera: lens_sigma(flight, camera) for camera in range(len(flight.cameras)) if camera not in held}
        free, rule = _focal_length_rule(flight, control_count, sigmas)
        centre_free, centre_rule = _principal_point_rule(flight, sigmas)
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


def _focal_length_rule(flight: Flight, control_count: int, sigmas: dict[int, LensSigma]) -> tuple[bool, str]:
    """Tell whether something determines the focal length, and how that was seen."""
    oblique, spread = _oblique_share(flight), _height_spread(flight)
    if control_count >= ENOUGH_CONTROL:
        return True, f"{control_count} control points determine it"
    if oblique < OBLIQUE_SHARE and spread < HEIGHT_SPREAD:
        return (
            False,
            f"only {oblique:.0%} of the views are oblique and heights differ by {spread:.0%}: any value would fit",
        )
    for camera, sigma in sigmas.items():
        if sigma.focal_length > FOCAL_LENGTH_SHARES[flight.calibrations[camera]]:
            return False, f"views of such directions and positions leave it open to {sigma.focal_length:.1%}"
    if oblique >= OBLIQUE_SHARE:
        return True, f"{oblique:.0%} of the views are oblique"
    return True, f"flying heights differ by {spread:.0%}"


def _principal_point_rule(flight: Flight, sigmas: dict[int, LensSigma]) -> tuple[bool, str]:
    """Tell whether the flight determines where the lenses' axes meet the pictures."""
    worst = max(sigmas, key=lambda camera: sigmas[camera].principal_point / flight.cameras[camera].width)
    pixels = sigmas[worst].principal_point
    if pixels <= PRINCIPAL_POINT_SHARE * flight.cameras[worst].width:
        return True, f"views turned and tilted against one another determine it to {pixels:.1f} px"
    return False, f"views of such directions and positions leave it open to {pixels:.0f} px"


def _oblique_share(flight: Flight) -> float:
    downward = -flight.rotations[flight.oriented][:, 2, 2]
    return float(np.mean(downward < np.cos(np.radians(OBLIQUE_ANGLE)))) if len(downward) else 0.0


def _height_spread(flight: Flight) -> float:
    """Return how much flying heights differ, by their median: as positions tell it, or the barometer where it's better.

    What the positions' noise makes of one height is taken off.
    """
    above = flight.positions[:, 2] - ground_height(flight)
    sigma = float(np.median(flight.position_sigma[:, 2]))
    relative = [record.height_above_takeoff for record in flight.records]
    if sigma > LARGEST_HEIGHT_SIGMA and None not in relative and min(map(float, relative)) > 0:  # type: ignore[arg-type]
        above, sigma = np.array(relative, np.float64), 0.0
    low, high = np.percentile(above, OUTERMOST)
    return max(0.0, float(high - low) - NOISE_SPREAD * sigma) / float(np.median(above))
