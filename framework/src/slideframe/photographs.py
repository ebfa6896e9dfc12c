"""Photographs read from disk as a distortion-free pinhole would have taken them."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.errors import InputError
from slideframe.masks import Mask, read_mask
from slideframe.products import Camera, Survey


def load_photograph(survey: Survey, index: int, *, width: int | None = None) -> tuple[UInt8Array, Camera, Mask | None]:
    """Return photograph `index` undistorted, its pinhole camera, and which pixels the lens saw and its mask leaves.

    A wider photograph is first reduced to `width` px by averaging areas. The pinhole keeps the (scaled)
    focal lengths and principal point, so a point in front of the camera has the same place in both
    but for distortion.

    Returns:
        pixels (height, width, 3), the camera without distortion, and the mask (height, width), true
        where the photograph has a pixel that its mask doesn't leave out, or None where all are so.

    Raises:
        InputError: the file is missing, damaged, or not of the camera's size.
    """
    camera = survey.camera_of(index)
    photograph = survey.photographs[index]
    image = _read(photograph.path, camera)
    if width is not None and width < camera.width:
        camera = reduce_camera(camera, width)
        image = image.resize((camera.width, camera.height), Image.Resampling.BOX)
    pixels = np.asarray(image)
    used = read_mask(photograph.mask, camera.width, camera.height) if photograph.mask else None
    if not any(camera.distortion):
        return pixels, camera, used
    columns, rows = distorted_positions(camera)
    seen = (columns >= -0.5) & (columns <= camera.width - 0.5) & (rows >= -0.5) & (rows <= camera.height - 0.5)
    if used is not None:
        seen &= used[
            rows.round().astype(int).clip(0, camera.height - 1), columns.round().astype(int).clip(0, camera.width - 1)
        ]
    pinhole = camera.model_copy(update={"distortion": (0.0, 0.0, 0.0, 0.0, 0.0)})
    return _sample(pixels, columns, rows), pinhole, None if seen.all() else seen


def reduce_camera(camera: Camera, width: int) -> Camera:
    """Return the camera of the same photograph scaled to `width` px, the height rounded to whole pixels."""
    height = max(1, round(camera.height * width / camera.width))
    across, down = width / camera.width, height / camera.height
    return Camera(
        width=width,
        height=height,
        focal_x=camera.focal_x * across,
        focal_y=camera.focal_y * down,
        principal_x=camera.principal_x * across,
        principal_y=camera.principal_y * down,
        distortion=camera.distortion,
    )


def distort(slopes: Float64Array, distortion: tuple[float, float, float, float, float]) -> Float64Array:
    """Return where the lens puts the rays `slopes` (…, 2) = (x/z, y/z): OpenCV's model (k1, k2, p1, p2, k3)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = slopes[..., 0], slopes[..., 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def distorted_positions(camera: Camera) -> tuple[Float64Array, Float64Array]:
    """Return column and row (height, width) in the photograph of every pixel of the pinhole, 0 at a pixel's centre."""
    x = (np.arange(camera.width) + 0.5 - camera.principal_x) / camera.focal_x
    y = (np.arange(camera.height) + 0.5 - camera.principal_y) / camera.focal_y
    found = distort(np.stack(np.meshgrid(x, y), axis=-1), camera.distortion)
    return (
        found[..., 0] * camera.focal_x + camera.principal_x - 0.5,
        found[..., 1] * camera.focal_y + camera.principal_y - 0.5,
    )


def _read(path: Path, camera: Camera) -> Image.Image:
    try:
        with Image.open(path) as file:
            image = file.convert("RGB")
    except FileNotFoundError as error:
        raise InputError(
            "a photograph is missing", where=str(path), cure="put it back, or locate the cameras anew"
        ) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(
            f"a photograph can't be read: {error}", where=str(path), cure="copy it again from the drone, or remove it"
        ) from error
    if image.size != (camera.width, camera.height):
        raise InputError(
            f"a photograph is {image.width}x{image.height} px but its camera {camera.width}x{camera.height}",
            where=str(path),
            cure="use the photograph as the drone wrote it, or locate the cameras anew",
        )
    return image


def _sample(pixels: UInt8Array, columns: Float64Array, rows: Float64Array) -> UInt8Array:
    """Interpolate bilinearly; beyond the edge the nearest pixel repeats."""
    height, width = pixels.shape[:2]
    columns, rows = columns.clip(0, width - 1), rows.clip(0, height - 1)
    left, top = columns.astype(np.int32), rows.astype(np.int32)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across = (columns - left).astype(np.float32)[..., None]
    down = (rows - top).astype(np.float32)[..., None]
    flat = pixels.reshape(-1, 3)

    def at(row: npt.NDArray[np.int32], column: npt.NDArray[np.int32]) -> Float32Array:
        return np.asarray(flat[row * width + column], np.float32)

    upper = at(top, left) * (1 - across) + at(top, right) * across
    lower = at(bottom, left) * (1 - across) + at(bottom, right) * across
    return np.rint(upper * (1 - down) + lower * down).astype(np.uint8)
