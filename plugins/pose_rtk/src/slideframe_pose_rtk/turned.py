"""Photographs that turn out to look another way than their gimbal angles say."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.intrinsics import UPENDED_QUARTERS, is_upended, turned_camera
from slideframe_pose_rtk.lens import camera_from_lens, exact_lens
from slideframe_pose_rtk.naming import names
from slideframe_pose_rtk.orientation import about_up
from slideframe_pose_rtk.sessions import Session

if TYPE_CHECKING:
    import pycolmap

# Gimbals and compasses were found up to 5 degrees off on real flights; what is beyond these isn't their noise.
LARGEST_TILT = 15.0  # degrees between the lines of sight
LARGEST_TWIST = 15.0  # degrees about the line of sight, from the nearest quarter turn
# Programs turn single pictures; where more of a flight are turned, it's the compass that is wrong.
LARGEST_SHARE = 1 / 3


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


def turned_pictures(flight: Flight, poses: Poses, sessions: tuple[Session, ...]) -> dict[int, int]:
    """Return by photograph the quarter turns by which its camera still has to be turned, for it was taken unturned.

    A picture stood on end has a turned camera already, see `intrinsics`. An odd turn of any other picture is none of
    the picture, whose sides show it, but a false angle.
    """
    turns = {}
    for session in sessions:
        known = [index for index in session.indices.tolist() if index in poses and flight.oriented[index]]
        if not known:
            continue
        found = np.array([poses[index][:, :3] for index in known])
        twists, tilts = twist_and_tilt(flight.rotations[known], found)
        quarters = np.round(twists / 90.0).astype(int) % 4
        turned = (tilts < LARGEST_TILT) & (np.abs(twists - 90.0 * np.round(twists / 90.0)) < LARGEST_TWIST)
        turned &= quarters > 0
        if turned.mean() > LARGEST_SHARE:
            continue
        for index, quarter in zip(np.array(known)[turned].tolist(), quarters[turned].tolist(), strict=True):
            left = (quarter - UPENDED_QUARTERS * is_upended(flight.records[index])) % 4
            if left == 2:
                turns[index] = left
    return turns


def turn_cameras(flight: Flight, lenses: "list[pycolmap.Camera]", turns: dict[int, int]) -> Flight:
    """Return the flight in which those photographs have cameras turned by their quarters; append these to `lenses`.

    Their orientations are turned as well, so that none is turned twice.
    """
    cameras, calibrations = list(flight.cameras), list(flight.calibrations)
    camera_of, rotations = list(flight.camera_of), flight.rotations.copy()
    numbers: dict[tuple[int, int], int] = {}
    for index, quarters in turns.items():
        key = (camera_of[index], quarters)
        if key not in numbers:
            numbers[key] = len(cameras)
            camera = turned_camera(camera_from_lens(lenses[key[0]]), quarters)
            cameras.append(camera)
            calibrations.append(calibrations[key[0]])
            lenses.append(exact_lens(camera, len(cameras)))
        camera_of[index] = numbers[key]
        rotations[index] = rotations[index] @ about_up(90.0 * quarters)
    return dataclasses.replace(
        flight,
        cameras=tuple(cameras),
        calibrations=tuple(calibrations),
        camera_of=tuple(camera_of),
        rotations=rotations,
    )


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
