"""How far the stated positions are believed, told by what the photographs say of them."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.quality.appraisal import LEAST_OUTLIER, OUTLIER_SIGMAS
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight, Poses
from slideframe_pose_rtk.naming import names

NORMAL_MEDIAN = 0.6745  # median of |x| / sigma where x is normal
FAR_OUT = 6.0  # sigmas
# Adjustment takes up part of the noise, so residuals are smaller than sigmas that are true (Mirafiori: 0.9 of them).
ACCEPTED_SCALE = 2.0
MOST_DISTRUSTED = 1 / 3  # of the photographs: more false positions than that can't be told from true ones


@dataclass(frozen=True)
class Trust:
    """What the adjustment holds the centres to.

    Attributes:
        sigma_scale: factor on every stated sigma.
        distrusted: photographs whose position is left out of account.
    """

    sigma_scale: float = 1.0
    distrusted: frozenset[int] = frozenset()


def weigh(flight: Flight, poses: Poses) -> Trust:
    """Compare adjusted centres with stated positions.

    The scale is the rms of what isn't far out by the median's measure, so that false positions don't raise it; it is
    used from `ACCEPTED_SCALE` on.
    """
    indices = sorted(poses)
    residuals = np.abs(_residuals(flight, poses, indices))
    sigma = flight.position_sigma[indices]
    ratios = residuals / sigma
    usual = ratios[ratios <= FAR_OUT * max(float(np.median(ratios)) / NORMAL_MEDIAN, 1.0)]
    scale = float(np.sqrt(np.mean(usual**2))) if len(usual) else 1.0
    scale = scale if scale > ACCEPTED_SCALE else 1.0
    beyond = ((residuals > OUTLIER_SIGMAS * scale * sigma) & (residuals > LEAST_OUTLIER)).any(axis=1)
    if beyond.mean() > MOST_DISTRUSTED:
        return Trust(scale)
    return Trust(scale, frozenset(index for index, out in zip(indices, beyond, strict=True) if out))


def warn_of_positions(flight: Flight, poses: Poses, trust: Trust, context: Context) -> None:
    """State which positions contradict the others, and whether all scatter more than they should."""
    known = sorted(set(poses) - trust.distrusted)
    if trust.sigma_scale > 1:
        scatter = np.sqrt(np.mean(_residuals(flight, poses, known) ** 2, axis=0))
        east, north, up = scatter
        context.warn(
            f"positions scatter {trust.sigma_scale:.1f} times as much as their sigmas say ({east:.2f}, {north:.2f},"
            f" {up:.2f} m rms east, north, up): all sigmas are raised by that factor"
        )
    false = sorted(trust.distrusted & set(poses))
    if false:
        farthest = float(np.linalg.norm(_residuals(flight, poses, false), axis=1).max())
        context.warn(
            f"the positions of {len(false)} photographs contradict all others by up to {farthest:.2f} m and are not"
            f" used: {names([flight.records[index] for index in false])}"
        )


def _residuals(flight: Flight, poses: Poses, indices: list[int]) -> Float64Array:
    return np.array([poses[index][:, 3] - flight.positions[index] for index in indices]).reshape(-1, 3)
