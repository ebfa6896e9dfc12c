"""Splats to the arrays of a picture, with the rasteriser that they were trained with."""

from typing import Any

import numpy as np
import torch

from slideframe.arrays import Float32Array, Float64Array
from slideframe.coupling import MovedSplats
from slideframe.problem import View
from slideframe.products import Camera
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.threads import one_torch_thread, run_shares
from slideframe_render_gs.picture_kernels import write_levels

# Less light than this, held back in one pixel of 8 bits, is nothing.
LEAST_ALPHA = 1.0 / 255.0


def enlarge(camera: Camera, factor: int) -> Camera:
    """Return the camera with its pixels divided into factor x factor smaller ones."""
    lengths = ("focal_x", "focal_y", "principal_x", "principal_y", "width", "height")
    return camera.model_copy(update={name: factor * getattr(camera, name) for name in lengths})


def draw(
    splats: MovedSplats, camera: Camera, world_from_camera: Float64Array, view: View
) -> tuple[dict[str, Any], bool]:
    """Return the pixels and the asked-for maps of a picture, by the names of its fields, and whether it shows any."""
    factor = view.supersampling
    # torch's own threads go on spinning after their part, against ours
    with torch.no_grad(), one_torch_thread():
        raster = rasterize(
            torch.from_numpy(splats.centers),
            torch.from_numpy(splats.rotations),
            torch.from_numpy(splats.scales),
            torch.from_numpy(splats.opacities),
            torch.from_numpy(splats.harmonics),
            camera=enlarge(camera, factor),
            world_from_camera=world_from_camera,
            background=view.background,
            depth="depth" in view.maps,
            normals="normal" in view.maps,
            frame_rotations=splats.frame_rotations if splats.harmonics.shape[1] > 1 else None,
        )
    colour = _shrunk(raster.colour.numpy(), factor)
    levels = np.empty((camera.height, camera.width, 3), np.uint8)
    planes = np.ascontiguousarray(np.moveaxis(colour, 2, 0))
    run_shares(write_levels, camera.height, levels.size, planes, levels)
    fields: dict[str, Any] = {"pixels": levels}
    fine_alpha = raster.alpha.numpy()
    alpha = _shrunk(fine_alpha, factor)
    if "alpha" in view.maps:
        fields["alpha"] = alpha
    if raster.depth is not None:
        # where a pixel is half empty its depth is that of its other half
        weighted = _shrunk(raster.depth.numpy() * fine_alpha, factor)
        fields["depth"] = np.divide(weighted, alpha, out=np.zeros_like(alpha), where=alpha > 0)
    if raster.normals is not None:
        fields["normal"] = _unit(_shrunk(raster.normals.numpy() * fine_alpha[..., None], factor))
    return fields, bool(fine_alpha.max() > LEAST_ALPHA)


def _unit(vectors: Float32Array) -> Float32Array:
    """Return vectors (height, width, 3) of length 1, or 0 where they are."""
    length = np.linalg.norm(vectors, axis=2, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _shrunk(pixels: Float32Array, factor: int) -> Float32Array:
    """Return the means of blocks of factor x factor pixels."""
    if factor == 1:
        return pixels
    height, width = (size // factor for size in pixels.shape[:2])
    blocks = pixels.reshape(height, factor, width, factor, *pixels.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)
