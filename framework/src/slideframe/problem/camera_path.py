"""How a film's camera goes from view to view, and lenses that fit the film's picture."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Camera
from slideframe.rotations import quaternions_of, rotation_matrices

# The camera and its world_from_camera (3, 4) when a share, 0 to 1, of the film has passed.
Shot = Callable[[float], tuple[Camera, Float64Array]]

# A camera that looks this steeply down has north above, because up is no direction in its picture.
STEEPEST = 0.9999


def pinhole(width: int, height: int, field_of_view: float) -> Camera:
    """Return a camera with that horizontal field of view, degrees, and a central principal point."""
    focal = width / (2 * math.tan(math.radians(field_of_view) / 2))
    return Camera(
        width=width, height=height, focal_x=focal, focal_y=focal, principal_x=width / 2, principal_y=height / 2
    )


def fit_lens(camera: Camera, width: int, height: int) -> Camera:
    """Return the camera without distortion, scaled to the new width; top and bottom are cut, or more is seen there."""
    scale = width / camera.width
    return Camera(
        width=width,
        height=height,
        focal_x=camera.focal_x * scale,
        focal_y=camera.focal_y * scale,
        principal_x=width / 2 + (camera.principal_x - camera.width / 2) * scale,
        principal_y=height / 2 + (camera.principal_y - camera.height / 2) * scale,
    )


def look_at(position: Float64Array, target: Float64Array) -> Float64Array:
    """Return world_from_camera (3, 4) of a camera held level that looks from `position` to `target`, m."""
    forward = np.asarray(target, np.float64) - position
    forward = forward / np.linalg.norm(forward)
    up = np.array([0.0, 1.0, 0.0]) if abs(forward[2]) > STEEPEST else np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward, position])


@dataclass(frozen=True)
class Track:
    """A smooth curve through values (key, n) at shares (key,) of the film, and still before and after them.

    Between keys it is the cubic with the keys' values and slopes, a slope being that of the parabola
    through a key and its two neighbours; so it passes through every key, and never jumps in speed.
    """

    shares: Float64Array
    values: Float64Array

    def at(self, share: float) -> Float64Array:
        """Return the value (n,) when `share` of the film has passed."""
        shares, values = self.shares, self.values
        share = min(max(share, shares[0]), shares[-1])
        if len(shares) == 1:
            return np.asarray(values[0])
        order: Literal[1, 2] = 2 if len(shares) > 2 else 1
        slopes = np.gradient(values, shares, axis=0, edge_order=order)
        k = min(int(np.searchsorted(shares, share, side="right")) - 1, len(shares) - 2)
        length = shares[k + 1] - shares[k]
        t = (share - shares[k]) / length
        start, stop = (1 + 2 * t) * (1 - t) ** 2, t * t * (3 - 2 * t)
        leave, arrive = t * (1 - t) ** 2 * length, t * t * (t - 1) * length
        curve: Float64Array = start * values[k] + stop * values[k + 1] + leave * slopes[k] + arrive * slopes[k + 1]
        return curve


def evenly(count: int) -> Float64Array:
    """Return the shares of `count` keys spread over the film."""
    return np.linspace(0.0, 1.0, count) if count > 1 else np.zeros(1)


def through_views(cameras: Sequence[Camera], poses: Sequence[Float64Array], shares: Float64Array) -> Shot:
    """Return the shot that passes through cameras of one size with their poses (3, 4)."""
    places = Track(shares, np.array([pose[:, 3] for pose in poses]))
    turns = Track(shares, _aligned(quaternions_of(np.array([pose[:, :3] for pose in poses]))))
    lenses = Track(shares, np.array([(c.focal_x, c.focal_y, c.principal_x, c.principal_y) for c in cameras]))

    def shot(share: float) -> tuple[Camera, Float64Array]:
        focal_x, focal_y, principal_x, principal_y = map(float, lenses.at(share))
        camera = cameras[0].model_copy(
            update={"focal_x": focal_x, "focal_y": focal_y, "principal_x": principal_x, "principal_y": principal_y}
        )
        return camera, np.column_stack([rotation_matrices(turns.at(share)[None])[0], places.at(share)])

    return shot


def _aligned(quaternions: Float64Array) -> Float64Array:
    """Return quaternions (key, 4) with signs such that each is on its neighbour's side, so that the way is short."""
    products = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(products < 0, -1.0, 1.0)]))
    return quaternions * signs[:, None]
