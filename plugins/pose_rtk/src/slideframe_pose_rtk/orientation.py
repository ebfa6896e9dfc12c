"""From gimbal angles to camera orientation in the east-north-up frame."""

import numpy as np

from slideframe.arrays import Float64Array

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# At zero gimbal angles the camera's forward is the body's x, its right the body's y, its down the body's z.
CAMERA_TO_BODY = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

LOCKED = 1e-9  # cosine of a pitch that counts as straight up or down


def world_from_camera(yaw: float, pitch: float, roll: float) -> Float64Array:
    """Return the (3, 3) rotation from camera axes (right, down, forward) to east-north-up.

    The angles, in degrees, are DJI's: in north-east-down, turned in the order z (yaw), y (pitch), x (roll).
    A pitch of -90 looks straight down. Angles past nadir and a roll of 180 need no special case.
    """
    rotation: Float64Array = NED_TO_ENU @ _about_z(yaw) @ _about_y(pitch) @ _about_x(roll) @ CAMERA_TO_BODY
    return rotation


def world_from_downward_camera(yaw: float, pitch: float, roll: float) -> Float64Array:
    """Return the (3, 3) rotation of a camera fixed to a drone so that at zero angles it looks straight down.

    Pix4D's convention for its yaw, pitch and roll tags, degrees: turned z, y, x in north-east-down as well,
    with the top of the picture ahead.
    """
    rotation: Float64Array = (
        NED_TO_ENU @ _about_z(yaw) @ _about_y(pitch) @ _about_x(roll) @ _about_y(-90.0) @ CAMERA_TO_BODY
    )
    return rotation


def gimbal_angles(rotation: Float64Array) -> tuple[float, float, float]:
    """Return yaw, pitch and roll in degrees of a (3, 3) rotation, such that `world_from_camera` gives it back.

    Looking straight up or down, only the sum of yaw and roll is determined; roll is 0 then.
    """
    body = NED_TO_ENU.T @ rotation @ CAMERA_TO_BODY.T
    level = np.hypot(body[0, 0], body[1, 0])
    pitch = np.arctan2(-body[2, 0], level)
    if level < LOCKED:
        yaw, roll = np.arctan2(-body[0, 1], body[1, 1]), 0.0
    else:
        yaw, roll = np.arctan2(body[1, 0], body[0, 0]), np.arctan2(body[2, 1], body[2, 2])
    return float(np.degrees(yaw)), float(np.degrees(pitch)), float(np.degrees(roll))


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


def mean_rotation(rotations: Float64Array) -> Float64Array:
    """Return the (3, 3) rotation of least summed squared chordal distance from all of (rotation, 3, 3)."""
    left, _, right = np.linalg.svd(rotations.mean(axis=0))
    mean: Float64Array = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return mean


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
