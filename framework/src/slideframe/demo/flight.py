"""The demo's flight: where the drone was, how its gimbal pointed, and what its metadata say about it."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError

# Mean of all camera positions in the site's frame, m; the survey's frame has its origin there.
FLIGHT_MEAN = np.array([0.0, -22.5, 56.0])
YAW_BIAS = 0.8  # degrees, of the compass during this flight
GIMBAL_NOISE = 0.3  # degrees
# x, y, z of first and last photograph (m above the road), how many, yaw and pitch in degrees
_LINES = (
    ((-33.0, -22.0, 72.0), (33.0, -22.0, 72.0), 5, 90.0, -90.0),
    ((33.0, 6.0, 76.0), (-33.0, 6.0, 76.0), 5, -90.0, -90.0),
    ((-36.0, -50.0, 46.0), (34.0, -53.0, 46.0), 6, 12.0, -48.0),
    ((58.0, -46.0, 52.0), (52.0, 6.0, 62.0), 5, -47.0, -52.0),
    ((-54.0, 2.0, 60.0), (-58.0, -46.0, 50.0), 5, 52.0, -50.0),
    ((-27.0, -19.5, 34.0), (27.0, -20.5, 35.0), 6, -9.0, -46.0),
)
PHOTOGRAPH_COUNT = sum(line[2] for line in _LINES)


@dataclass(frozen=True)
class Flight:
    """True poses and reported metadata of each photograph. Angles are yaw, pitch, roll (NED, order ZYX), degrees.

    Attributes:
        positions: true camera centres in the survey's frame (photograph, 3), m.
        angles: true gimbal angles (photograph, 3).
        reported_positions: the same with the noise of RTK (photograph, 3), m.
        reported_angles: the same with bias and noise, to a tenth (photograph, 3).
        position_sigma: standard deviation of the noise, east, north, up (photograph, 3), m.
    """

    positions: Float64Array
    angles: Float64Array
    reported_positions: Float64Array
    reported_angles: Float64Array
    position_sigma: Float64Array

    @property
    def world_from_camera(self) -> Float64Array:
        """True poses (photograph, 3, 4)."""
        return np.stack(
            [
                np.column_stack([rotation_from_gimbal(*angles), position])
                for angles, position in zip(self.angles, self.positions, strict=True)
            ]
        )


def fly(photograph_count: int | None = None, *, seed: int = 7) -> Flight:
    """Plan and fly the lines, or an even choice of `photograph_count` of their photographs.

    Raises:
        ConfigurationError: fewer than 3 or more photographs than the plan has.
    """
    count = PHOTOGRAPH_COUNT if photograph_count is None else photograph_count
    if not 3 <= count <= PHOTOGRAPH_COUNT:
        raise ConfigurationError(
            f"the demo survey can't have {count} photographs",
            where="photograph_count",
            cure=f"choose 3 to {PHOTOGRAPH_COUNT}",
        )
    generator = np.random.default_rng(seed)
    positions, angles = _plan()
    positions = positions + generator.normal(0, (0.35, 0.35, 0.15), positions.shape)
    angles = angles + generator.normal(0, (0.9, 0.5, 0.05), angles.shape)
    sigma = np.array([0.0112, 0.0121, 0.0204]) * generator.uniform(0.85, 1.15, positions.shape)
    noise = generator.normal(0, 1, positions.shape) * sigma
    gimbal_error = generator.normal((YAW_BIAS, 0, 0), GIMBAL_NOISE, angles.shape)
    chosen = np.round(np.linspace(0, PHOTOGRAPH_COUNT - 1, count)).astype(int)
    positions = positions[chosen] - positions[chosen].mean(axis=0)
    reported = np.round(angles[chosen] + gimbal_error[chosen], 1)
    reported[:, 0] = (reported[:, 0] + 180) % 360 - 180
    return Flight(positions, angles[chosen], positions + noise[chosen], reported, sigma[chosen])


def rotation_from_gimbal(yaw: float, pitch: float, roll: float) -> Float64Array:
    """Return world_from_camera (3, 3): camera axes x right, y down, z forward, in east-north-up.

    The gimbal turns about down, right and forward in that order (ZYX) from level and facing north.
    """
    cy, cp, cr = np.cos(np.radians([yaw, pitch, roll]))
    sy, sp, sr = np.sin(np.radians([yaw, pitch, roll]))
    about_down = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_right = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_forward = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    enu_from_ned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    body_from_camera = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    rotation: Float64Array = enu_from_ned @ about_down @ about_right @ about_forward @ body_from_camera
    return rotation


def _plan() -> tuple[Float64Array, Float64Array]:
    positions, angles = [], []
    for first, last, count, yaw, pitch in _LINES:
        positions.append(np.linspace(first, last, count))
        angles.append(np.tile([yaw, pitch, 0.0], (count, 1)))
    return np.concatenate(positions), np.concatenate(angles)
