"""A plain splat painter in NumPy: an eye that belongs to no plugin."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.harmonics import basis
from slideframe.products import Camera, SplatCloud

NEAR = 0.5
# Blur that keeps a splat at least a pixel wide, px^2 (Kerbl et al. 2023).
PIXEL_VARIANCE = 0.3


def paint(splats: SplatCloud, camera: Camera, world_from_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Blend the splats front to back; return the picture (height, width, 3), 0 to 1, and what passes.

    The second array (height, width) is the share of light that no splat held back.

    Args:
        splats: any cloud.
        camera: its distortion moves the splats' centres.
        world_from_camera: (3, 4), m.
    """
    rotation, place = world_from_camera[:, :3], world_from_camera[:, 3]
    seen = (splats.centers - place) @ rotation
    order = np.flatnonzero(seen[:, 2] > NEAR)
    order = order[np.argsort(seen[order, 2], kind="stable")]
    spread = rotation.T @ _covariances(splats)[order] @ rotation
    middles, variances = project(seen[order], camera), _spread_on_picture(seen[order], spread, camera)
    colors = _colors(splats, place)[order]
    picture, light = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width))
    for middle, variance, color, opacity in zip(middles, variances, colors, splats.opacities[order], strict=True):
        _blend(picture, light, middle, variance, color, float(opacity))
    return picture, light


def _colors(splats: SplatCloud, place: Float64Array) -> Float64Array:
    """Return the colours (n, 3), 0 to 1, that the splats show to a camera at `place`."""
    away = splats.centers - place
    functions = basis(away / np.linalg.norm(away, axis=1, keepdims=True))
    colors = np.einsum("pk,pkc->pc", functions[:, : splats.harmonics.shape[1]], splats.harmonics)
    return np.asarray(np.clip(0.5 + colors, 0, 1), np.float64)


def _covariances(splats: SplatCloud) -> Float64Array:
    w, x, y, z = splats.rotations.astype(np.float64).T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    shape = rotation * splats.scales[:, None, :]
    return np.asarray(shape @ np.swapaxes(shape, 1, 2), np.float64)


def project(seen: Float64Array, camera: Camera) -> Float64Array:
    """Return the pixels (n, 2) of points (n, 3) in camera axes, m, through OpenCV's distortion."""
    x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
    k1, k2, p1, p2, k3 = camera.distortion
    # beyond the picture's corner the polynomial turns back on itself
    square = np.minimum(x * x + y * y, 1.5)
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    u = camera.focal_x * (x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)) + camera.principal_x
    v = camera.focal_y * (y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y) + camera.principal_y
    return np.stack([u, v], axis=1)


def _spread_on_picture(seen: Float64Array, spread: Float64Array, camera: Camera) -> Float64Array:
    """Return covariances (n, 2, 2), px^2, of splats with covariances (n, 3, 3), m^2, in a pinhole's picture."""
    slope = np.zeros((len(seen), 2, 3))
    slope[:, 0, 0], slope[:, 1, 1] = camera.focal_x / seen[:, 2], camera.focal_y / seen[:, 2]
    slope[:, 0, 2] = -camera.focal_x * seen[:, 0] / seen[:, 2] ** 2
    slope[:, 1, 2] = -camera.focal_y * seen[:, 1] / seen[:, 2] ** 2
    variance: Float64Array = slope @ spread @ np.swapaxes(slope, 1, 2) + PIXEL_VARIANCE * np.eye(2)
    return variance


def _blend(
    picture: Float64Array,
    light: Float64Array,
    middle: Float64Array,
    variance: Float64Array,
    color: Float64Array,
    opacity: float,
) -> None:
    """Add one splat within three standard deviations, in place; `light` is what still passes."""
    reach = 3 * np.sqrt(np.diag(variance))
    low = np.maximum(np.floor(middle - reach), 0).astype(int)
    high = np.minimum(np.ceil(middle + reach), [picture.shape[1], picture.shape[0]]).astype(int)
    if (low >= high).any():
        return
    box = np.s_[low[1] : high[1], low[0] : high[0]]
    dx = np.arange(low[0], high[0]) + 0.5 - middle[0]
    dy = (np.arange(low[1], high[1]) + 0.5 - middle[1])[:, None]
    (a, b), (_, c) = np.linalg.inv(variance)
    alpha = np.minimum(opacity * np.exp(-0.5 * (a * dx * dx + 2 * b * dx * dy + c * dy * dy)), 0.99)
    picture[box] += (light[box] * alpha)[..., None] * color
    light[box] *= 1 - alpha
