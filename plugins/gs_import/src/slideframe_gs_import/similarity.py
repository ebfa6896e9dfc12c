"""The similarity that carries one frame onto another, from the cameras that stand in both."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array


@dataclass(frozen=True)
class Similarity:
    """x' = scale R x + translation.

    Attributes:
        scale: lengths in the new frame for one of the old.
        rotation: (3, 3).
        translation: (3,), in the new frame's unit.
    """

    scale: float
    rotation: Float64Array
    translation: Float64Array

    def apply(self, points: Float64Array) -> Float64Array:
        """Return the places (point, 3) in the new frame."""
        return self.scale * points @ self.rotation.T + self.translation


def between_cameras(old: Float64Array, new: Float64Array) -> Similarity:
    """Return the similarity from the poses (camera, 3, 4) of at least two cameras in both frames.

    Each camera counts by four points: its centre, and the ends of its three axes, which are as long as the
    centres are spread. The axes settle the turn about the line where all centres lie on one.

    Source: Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns".
    """
    from_points, to_points = _marks(old), _marks(new)
    from_middle, to_middle = from_points.mean(axis=0), to_points.mean(axis=0)
    from_arms, to_arms = from_points - from_middle, to_points - to_middle
    left, sizes, right = np.linalg.svd(to_arms.T @ from_arms)
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * mirror) @ right
    scale = float(sizes @ mirror / (from_arms**2).sum())
    return Similarity(scale, rotation, to_middle - scale * rotation @ from_middle)


def spread(poses: Float64Array) -> float:
    """Return the root mean square distance of the centres of poses (camera, 3, 4) from their mean."""
    centres = poses[:, :, 3]
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _marks(poses: Float64Array) -> Float64Array:
    """Return four points (4 camera, 3) of each camera."""
    ends = poses[:, :, 3, None] + spread(poses) * poses[:, :, :3]
    return np.concatenate([poses[:, :, 3:], ends], axis=2).transpose(0, 2, 1).reshape(-1, 3)
