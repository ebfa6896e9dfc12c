"""Between slideframe's cameras and COLMAP's models."""

from typing import TYPE_CHECKING

import numpy as np

from slideframe.errors import StageFailed
from slideframe.products import Camera

if TYPE_CHECKING:
    import pycolmap

FIT_SAMPLES = 200


def exact_lens(camera: Camera, camera_id: int) -> "pycolmap.Camera":
    """Return COLMAP's FULL_OPENCV with k4 = k5 = k6 = 0, which is OpenCV's five coefficients exactly."""
    k1, k2, p1, p2, k3 = camera.distortion
    return _lens(camera, camera_id, "FULL_OPENCV", (k1, k2, p1, p2, k3, 0.0, 0.0, 0.0))


def pinhole_lens(camera: Camera, camera_id: int) -> "pycolmap.Camera":
    """Return COLMAP's PINHOLE, for pictures without distortion, whose adjustment must not invent one."""
    return _lens(camera, camera_id, "PINHOLE", ())


def adjustable_lens(camera: Camera, camera_id: int) -> "pycolmap.Camera":
    """Return COLMAP's OPENCV with k1 and k2 closest to the given k1, k2 and k3.

    Adjusting FULL_OPENCV diverges; adjusting these four doesn't, and starts close by. The fit is least
    squares over the picture's area of the radial displacement k1 r^3 + k2 r^5 + k3 r^7.
    """
    k1, k2, p1, p2, k3 = camera.distortion
    if k3:
        corner = np.hypot(camera.width / (2 * camera.focal_x), camera.height / (2 * camera.focal_y))
        radius = (np.arange(FIT_SAMPLES) + 0.5) / FIT_SAMPLES * corner
        weight = np.sqrt(radius)  # rings of equal width cover an area proportional to their radius
        terms = np.column_stack([radius**3, radius**5]) * weight[:, None]
        wanted = (k1 * radius**3 + k2 * radius**5 + k3 * radius**7) * weight
        k1, k2 = (float(value) for value in np.linalg.lstsq(terms, wanted, rcond=None)[0])
    return _lens(camera, camera_id, "OPENCV", (k1, k2, p1, p2))


def camera_from_lens(lens: "pycolmap.Camera") -> Camera:
    """Return the camera that an adjusted PINHOLE, OPENCV or FULL_OPENCV lens is.

    Raises:
        StageFailed: the adjustment left an impossible camera, or the model has rational coefficients.
    """
    fx, fy, cx, cy, *distortion = (float(value) for value in lens.params)
    k1, k2, p1, p2, k3, *rational = [*distortion, *[0.0] * (5 - len(distortion))]
    if any(rational) or min(fx, fy) <= 0 or not np.isfinite(lens.params).all():
        raise StageFailed(
            f"the adjusted camera is impossible: {lens.model_name} {lens.params_to_string()}",
            cure="hold the focal length (focal_length = 'held'), or use the metadata's poses (refine = false)",
        )
    return Camera(
        width=lens.width,
        height=lens.height,
        focal_x=fx,
        focal_y=fy,
        principal_x=cx,
        principal_y=cy,
        distortion=(k1, k2, p1, p2, k3),
    )


def _lens(camera: Camera, camera_id: int, model: str, distortion: tuple[float, ...]) -> "pycolmap.Camera":
    import pycolmap

    lens = pycolmap.Camera(
        camera_id=camera_id,
        model=model,
        width=camera.width,
        height=camera.height,
        params=[camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y, *distortion],
    )
    lens.has_prior_focal_length = True
    return lens
