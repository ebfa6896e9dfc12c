"""The tilt of a survey whose positions leave it open: taken from the gimbal's angles, which know the vertical."""

from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.orientation import about_up, yaw_bias
from slideframe_pose_rtk.trust import Trust

if TYPE_CHECKING:
    import pycolmap

# Of a gimbal's pitch and roll over a whole flight, mount and principal point included (Mirafiori: 0.7 degrees).
TILT_SIGMA = 1.0  # degrees
ROUNDS = 4  # each linear in a turn of some degrees
GAUGE, TILT = 7, slice(0, 2)  # turn about east, north, up; shift; scale


def levelling(flight: Flight, poses: Poses, trust: Trust, context: Context) -> "pycolmap.Sim3d | None":
    """Return what carries the solution to where positions and gimbal put it together; None where positions suffice.

    Positions along one line, as of a single strip, or of some metres' noise tell a solution's place and scale, but not
    which way is up: they leave the tilt open by sigma over the flight's breadth. Where that is more than the gimbal
    does, it is the weighted mean of both.
    """
    import pycolmap

    known = [index for index in sorted(poses) if flight.oriented[index] and index not in trust.distrusted]
    if len(known) < 2:
        return None
    found = np.array([poses[index][:, :3] for index in known])
    centres = np.array([poses[index][:, 3] for index in known])
    sigma = trust.sigma_scale * flight.position_sigma[known]
    rotation, shift, scale = np.eye(3), np.zeros(3), 1.0
    for _ in range(ROUNDS):
        places, turned = scale * centres @ rotation.T + shift, rotation @ found
        normal, right = _by_positions(places, flight.positions[known], sigma)
        uncertainty = float(np.degrees(np.sqrt(np.linalg.eigvalsh(np.linalg.pinv(normal)[TILT, TILT]).max())))
        if uncertainty < TILT_SIGMA and np.linalg.matrix_rank(normal) == GAUGE:
            return None
        tilt = _tilt(flight.rotations[known], turned)
        normal[TILT, TILT] += np.eye(2) / np.radians(TILT_SIGMA) ** 2
        right[TILT] += tilt / np.radians(TILT_SIGMA) ** 2
        step = np.linalg.lstsq(normal, right, rcond=None)[0]
        turn = np.asarray(pycolmap.Rotation3d(step[:3]).matrix())
        middle = places.mean(axis=0)
        rotation, scale = turn @ rotation, scale * float(np.exp(step[6]))
        shift = float(np.exp(step[6])) * turn @ (shift - middle) + middle + step[3:6]
    context.warn(
        "the positions don't tell which way is up (they lie on one line, or their sigmas are too large for their"
        " spread): the survey is levelled by its gimbal angles"
    )
    return pycolmap.Sim3d(scale, pycolmap.Rotation3d(rotation), shift)


def _by_positions(places: Float64Array, stated: Float64Array, sigma: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return normal matrix (7, 7) and right side of a small similarity about the places' mean, from positions alone."""
    arms = places - places.mean(axis=0)
    design = np.zeros((len(places), 3, GAUGE))
    design[:, :, :3] = np.cross(np.eye(3)[None], arms[:, None]).transpose(0, 2, 1)
    design[:, :, 3:6] = np.eye(3)
    design[:, :, 6] = arms
    weighted = (design / sigma[:, :, None]).reshape(-1, GAUGE)
    return weighted.T @ weighted, weighted.T @ ((stated - places) / sigma).ravel()


def _tilt(stated: Float64Array, found: Float64Array) -> Float64Array:
    """Return the turn (2,) about east and north, rad, that carries found orientations to stated ones: medians."""
    turns = about_up(-yaw_bias(stated, found)) @ stated @ np.swapaxes(found, 1, 2)
    tilt: Float64Array = np.median(
        np.column_stack([turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0]]) / 2, axis=0
    )
    return tilt
