"""The differentiable rasteriser: splats in, a picture out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_gs_torch import compiled
from slideframe_gs_torch.harmonics import evaluate_harmonics
from slideframe_gs_torch.reference import composite_exactly

__all__ = ["Raster", "evaluate_harmonics", "rasterize"]


@dataclass(frozen=True)
class Raster:
    """A rasterised view.

    Attributes:
        colour: (height, width, 3), over the background.
        alpha: (height, width), 0 where only the background is seen.
        depth: (height, width), m along the view axis, the mean over the splats seen; 0 where there is none.
    """

    colour: Tensor
    alpha: Tensor
    depth: Tensor


def rasterize(
    centers: Tensor,
    rotations: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colours: Tensor,
    *,
    camera: Camera,
    world_from_camera: Float64Array,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    backend: Literal["numba", "torch"] = "numba",
    screen_gradients: Tensor | None = None,
) -> Raster:
    """Draw splats as a pinhole camera sees them (Kerbl et al. 2023), differentiable in the five tensors.

    Args:
        centers: (splat, 3), m.
        rotations: (splat, 4), quaternions wxyz, normalised here.
        scales: (splat, 3), standard deviations, m.
        opacities: (splat,), 0 to 1.
        colours: (splat, 3), as seen from this camera; see `evaluate_harmonics`.
        camera: without distortion; its principal point may lie anywhere.
        world_from_camera: (3, 4), m.
        background: colour where no splat is.
        backend: `numba` is compiled and float32; `torch` is slow, exact, and takes float64.
        screen_gradients: (splat, 2), filled in the backward pass of `numba` with the sum over tiles of
            |dL/d(projected centre)|, per px.

    Raises:
        InputError: the camera has lens distortion.
    """
    if any(camera.distortion):
        raise InputError(
            "a camera with lens distortion can't be rasterised",
            where=f"distortion {camera.distortion}",
            cure="undistort the photograph and its camera with slideframe.photographs.load_photograph",
        )
    rotation = np.asarray(world_from_camera, np.float64)[:, :3]
    camera_from_world = np.column_stack([rotation.T, -rotation.T @ world_from_camera[:, 3]])
    splats = (centers, rotations, scales, opacities, colours)
    if backend == "torch":
        planes, transmittance = composite_exactly(*splats, camera, camera_from_world)
    else:
        scene = compiled.View.of(camera, camera_from_world)
        planes, transmittance = _Compiled.apply(*splats, scene, screen_gradients)  # type: ignore[no-untyped-call]
    alpha = 1 - transmittance
    behind = torch.as_tensor(background, dtype=planes.dtype)[:, None, None] * transmittance
    return Raster((planes[:3] + behind).permute(1, 2, 0), alpha, planes[3] / alpha.clamp_min(1e-6))


class _Compiled(torch.autograd.Function):
    """The compiled kernels on the boundary of autograd."""

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, Tensor]:
        *splats, view, screen_gradients = arguments
        arrays = compiled.Splats(*(np.ascontiguousarray(tensor.detach().numpy(), np.float32) for tensor in splats))
        drawing = compiled.draw(arrays, view)
        ctx.state = arrays, view, drawing, screen_gradients
        return torch.from_numpy(drawing.planes), torch.from_numpy(drawing.transmittance)

    @staticmethod
    def backward(ctx: Any, d_planes: Tensor, d_transmittance: Tensor) -> tuple[Any, ...]:
        arrays, view, drawing, screen_gradients = ctx.state
        by_planes, by_transmittance = (np.ascontiguousarray(g.numpy(), np.float32) for g in (d_planes, d_transmittance))
        gradients, d_means = compiled.draw_backward(arrays, view, drawing, by_planes, by_transmittance)
        if screen_gradients is not None:
            screen_gradients.copy_(torch.from_numpy(d_means))
        return *(torch.from_numpy(gradient) for gradient in gradients), None, None
