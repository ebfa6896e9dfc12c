"""The demo's camera: the wide camera of a DJI Mavic 3 Enterprise, its pictures reduced in size."""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Camera

FULL_WIDTH, FULL_HEIGHT = 5280, 3956
FOCAL_LENGTH = 12.29  # mm
SENSOR_WIDTH = 17.3  # mm
# The maker's design focal length, the same for every camera of the model, px at full size
DESIGN_FOCAL = FOCAL_LENGTH / SENSOR_WIDTH * FULL_WIDTH
# What this camera measures, px at full size: the principal point counts from the picture's middle
MEASURED_FOCAL = (3718.42, 3717.86)
PRINCIPAL_OFFSET = (7.35, -9.12)
DISTORTION = (-0.11086, 0.01247, -0.00021, 0.00014, -0.02581)  # k1, k2, p1, p2, k3


def full_size_camera() -> Camera:
    """Return the camera before its pictures are reduced."""
    return Camera(
        width=FULL_WIDTH,
        height=FULL_HEIGHT,
        focal_x=MEASURED_FOCAL[0],
        focal_y=MEASURED_FOCAL[1],
        principal_x=FULL_WIDTH / 2 + PRINCIPAL_OFFSET[0],
        principal_y=FULL_HEIGHT / 2 + PRINCIPAL_OFFSET[1],
        distortion=DISTORTION,
    )


def reduced_camera(width: int) -> Camera:
    """Return the camera whose pictures are `width` pixels wide; part of the last row is lost."""
    full, scale = full_size_camera(), width / FULL_WIDTH
    return Camera(
        width=width,
        height=round(FULL_HEIGHT * scale),
        focal_x=full.focal_x * scale,
        focal_y=full.focal_y * scale,
        principal_x=full.principal_x * scale,
        principal_y=full.principal_y * scale,
        distortion=full.distortion,
    )


def project(points: Float64Array, world_from_camera: Float64Array, camera: Camera) -> Float64Array:
    """Return the pixels (point, 2) of world points (point, 3) in front of the camera (OpenCV's lens model)."""
    local = (points - world_from_camera[:, 3]) @ world_from_camera[:, :3]
    x, y = _distort(local[:, 0] / local[:, 2], local[:, 1] / local[:, 2], camera)
    return np.column_stack([camera.focal_x * x + camera.principal_x, camera.focal_y * y + camera.principal_y])


def pixel_rays(camera: Camera) -> Float32Array:
    """Return each pixel centre's ray (row, column, 3) in camera axes, with z = 1.

    The lens is inverted by fixed-point iteration, which gains more than a digit a pass at this distortion.
    """
    distorted_x, distorted_y = np.meshgrid(
        (np.arange(camera.width) + 0.5 - camera.principal_x) / camera.focal_x,
        (np.arange(camera.height) + 0.5 - camera.principal_y) / camera.focal_y,
    )
    x, y = distorted_x, distorted_y
    for _ in range(12):
        again_x, again_y = _distort(x, y, camera)
        x, y = x + distorted_x - again_x, y + distorted_y - again_y
    return np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)


def _distort(x: Float64Array, y: Float64Array, camera: Camera) -> tuple[Float64Array, Float64Array]:
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
