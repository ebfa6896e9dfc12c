"""Poses of photographs that could not be registered: from their metadata, without the bias of their flight."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.orientation import about_up, angle_between, mean_rotation, yaw_bias
from slideframe_pose_rtk.sessions import Session

LEAST_REGISTERED = 3  # of a flight, for its bias to be known


@dataclass(frozen=True, eq=False)
class GimbalBias:
    """How a flight's stated orientations differ from those found, each cleared of one thing more.

    Attributes:
        yaw: turn about the vertical, degrees counter-clockwise, that best carries the stated to the found.
        mount: (3, 3) what is then left in common as the camera sees it: its tilt in the mount, or the principal point's
            place, which can't be told apart on a nadir flight.
        raw: (photograph,) degrees between stated and found.
        unbiased: the same after the turn.
        remaining: the same without the mount's tilt: the gimbal's own errors.
    """

    yaw: float
    mount: Float64Array
    raw: Float64Array
    unbiased: Float64Array
    remaining: Float64Array

    def corrected(self, stated: Float64Array) -> Float64Array:
        """Return stated orientations (…, 3, 3) without what is common to the flight."""
        rotations: Float64Array = about_up(self.yaw) @ stated @ self.mount
        return rotations


def gimbal_bias(flight: Flight, poses: Poses, session: Session) -> GimbalBias | None:
    """Compare a flight's stated orientations with those found; None where no photograph has both."""
    known = [index for index in session.indices if index in poses and flight.oriented[index]]
    if not known:
        return None
    found, stated = np.array([poses[index][:, :3] for index in known]), flight.rotations[known]
    yaw = yaw_bias(found, stated)
    turned = about_up(yaw) @ stated
    mount = mean_rotation(np.swapaxes(turned, 1, 2) @ found)
    return GimbalBias(
        yaw=yaw,
        mount=mount,
        raw=angle_between(found, stated),
        unbiased=angle_between(found, turned),
        remaining=angle_between(found, turned @ mount),
    )


def poses_from_metadata(
    flight: Flight, poses: Poses, sessions: tuple[Session, ...], missing: list[int]
) -> tuple[Poses, float]:
    """Return world from camera (3, 4) of those `missing` whose flight tells its bias, and the usual error, degrees.

    The centre is the stated position, the orientation the stated one without the flight's yaw bias and mount tilt; the
    error is the median that remains on the flight's registered photographs.
    """
    placed: Poses = {}
    errors = []
    for session in sessions:
        bias = gimbal_bias(flight, poses, session)
        if bias is None or len(bias.raw) < LEAST_REGISTERED:
            continue
        for index in set(missing) & set(session.indices.tolist()):
            if flight.oriented[index]:
                placed[index] = np.column_stack([bias.corrected(flight.rotations[index]), flight.positions[index]])
                errors.append(float(np.median(bias.remaining)))
    return placed, max(errors, default=0.0)
