"""Photographs that turn out to look another way than their gimbal angles say."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.naming import names

# Gimbals and compasses were found up to 5 degrees off on real flights; what is beyond these isn't their noise.
LARGEST_TILT = 15.0  # degrees between the lines of sight
LARGEST_TWIST = 15.0  # degrees about the line of sight, from the nearest quarter turn


def warn_of_turned(flight: Flight, poses: Poses, context: Context) -> None:
    """Name the photographs whose solved poses contradict their metadata, by how they do.

    Programs turn pictures for display and keep the metadata; a wrong compass does the same to views straight down.
    """
    known = [index for index in sorted(poses) if flight.oriented[index]]
    if not known:
        return
    found = np.array([poses[index][:, :3] for index in known])
    twists, tilts = twist_and_tilt(flight.rotations[known], found)
    quarters = np.round(twists / 90.0).astype(int) % 4
    turned = (tilts < LARGEST_TILT) & (np.abs(twists - 90.0 * np.round(twists / 90.0)) < LARGEST_TWIST)
    for quarter in (1, 2, 3):
        _warn(flight, known, turned & (quarters == quarter), f"turned by {90 * quarter} degrees", context)
    _warn(flight, known, ~turned, "otherwise than their gimbal angles say, by more than 15 degrees", context)


def twist_and_tilt(stated: Float64Array, found: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return how far the pictures are turned about their lines of sight, and how far these differ, degrees.

    Args:
        stated: (photograph, 3, 3), world from camera.
        found: (photograph, 3, 3), the same.

    The twist is that of the rotation about the camera's axis nearest to stated⁻¹ · found, clockwise as
    the pixels show it.
    """
    change = np.swapaxes(stated, -1, -2) @ found
    twists = np.degrees(np.arctan2(change[..., 1, 0] - change[..., 0, 1], change[..., 0, 0] + change[..., 1, 1]))
    tilts = np.degrees(np.arccos(np.clip(change[..., 2, 2], -1.0, 1.0)))
    return twists, tilts


def _warn(flight: Flight, known: list[int], which: np.ndarray, how: str, context: Context) -> None:
    records = [flight.records[index] for index, is_one in zip(known, which, strict=True) if is_one]
    if records:
        context.warn(
            f"{len(records)} of {len(flight)} photographs lie {how} against their metadata, and are placed by what they"
            f" show: {names(records)}"
        )
