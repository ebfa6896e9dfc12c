"""From gimbal angles to camera orientation in the east-north-up frame."""

import numpy as np

from slideframe.arrays import Float64Array

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# At zero gimbal angles the camera's forward is the body's x, its right the body's y, its down the body's z.
CAMERA_TO_BODY = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def world_from_camera(yaw: float, pitch: float, roll: float) -> Float64Array:
    """Return the (3, 3) rotation from camera axes (right, down, forward) to east-north-up.

    The angles, in degrees, are DJI's: in north-east-down, turned in the order z (yaw), y (pitch), x (roll).
    A pitch of -90 looks straight down. Angles past nadir and a roll of 180 need no special case.
    """
    rotation: Float64Array = NED_TO_ENU @ _about_z(yaw) @ _about_y(pitch) @ _about_x(roll) @ CAMERA_TO_BODY
    return rotation


def angle_between(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the angle in degrees of the rotation that carries each (…, 3, 3) `second` to `first`.

    atan2 of the sine and cosine of the angle, which stays exact for small angles where arccos doesn't.
    """
    turn = first @ np.swapaxes(second, -1, -2)
    axis = np.stack(
        [turn[..., 2, 1] - turn[..., 1, 2], turn[..., 0, 2] - turn[..., 2, 0], turn[..., 1, 0] - turn[..., 0, 1]],
        axis=-1,
    )
    angles: Float64Array = np.degrees(
        np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(turn, axis1=-2, axis2=-1) - 1.0)
    )
    return angles


def yaw_bias(measured: Float64Array, reference: Float64Array) -> float:
    """Return the turn about the vertical, in degrees counter-clockwise, that best carries `reference` to `measured`.

    Both are (photograph, 3, 3). The sum of squared chordal distances is least where the summed turns,
    projected on the vertical axis, point: atan2(Σ (T10 - T01), Σ (T00 + T11)).
    """
    turn = (measured @ np.swapaxes(reference, -1, -2)).sum(axis=0)
    return float(np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])))


def about_up(degrees: float) -> Float64Array:
    """Return the rotation about the vertical axis, counter-clockwise seen from above."""
    return _about_z(degrees)


def _about_x(degrees: float) -> Float64Array:
    cosine, sine = _cosine_and_sine(degrees)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _about_y(degrees: float) -> Float64Array:
    cosine, sine = _cosine_and_sine(degrees)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _about_z(degrees: float) -> Float64Array:
    cosine, sine = _cosine_and_sine(degrees)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _cosine_and_sine(degrees: float) -> tuple[float, float]:
    radians = np.radians(degrees)
    return float(np.cos(radians)), float(np.sin(radians))
