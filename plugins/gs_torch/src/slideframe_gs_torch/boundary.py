"""The compiled kernels on the boundary of autograd."""

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from slideframe.arrays import Float32Array
from slideframe.products import Camera
from slideframe_gs_torch import compiled
from slideframe_gs_torch.reference import PlaneDrawing


class _Settings(NamedTuple):
    camera: Camera
    antialiased: bool
    frames: Float32Array
    screen_gradients: Tensor | None


def draw_compiled(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, features: Tensor,
    background: Tensor, camera_from_world: Tensor, camera: Camera, antialiased: bool,
    frame_rotations: Float32Array | None, screen_gradients: Tensor | None,
) -> PlaneDrawing:  # fmt: skip
    """Draw with the compiled kernels; arguments as in `rasterize`, features (group, splat, 3)."""
    frames = compiled.NO_FRAMES if frame_rotations is None else np.ascontiguousarray(frame_rotations, np.float32)
    settings = _Settings(camera, antialiased, frames, screen_gradients)
    drawn = _Compiled.apply(  # type: ignore[no-untyped-call]
        centers, rotations, scales, opacities, colours, features, background, camera_from_world, settings
    )
    return PlaneDrawing(*drawn)


def _array(tensor: Tensor) -> Float32Array:
    return np.ascontiguousarray(tensor.detach().numpy(), np.float32)


def _gradient(tensor: Tensor | None, like: Float32Array) -> Float32Array:
    return np.zeros_like(like) if tensor is None else _array(tensor)


class _Compiled(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        *tensors, features, background, pose, settings = arguments
        ctx.set_materialize_grads(False)
        splats = compiled.Splats(*map(_array, tensors))
        view = compiled.View.of(settings.camera, pose.detach().numpy(), settings.antialiased)
        drawing = compiled.draw(splats, view, _array(background), settings.frames)
        shown = [_array(group) for group in features]
        planes = [compiled.composite(drawing.lists, view, group)[0] for group in shown]
        median = compiled.median_splats(drawing, view) if shown else np.empty((0, 0), np.int32)
        ctx.state = splats, view, drawing, shown, settings
        stacked = np.stack(planes) if planes else np.empty((0, 3, *view.size), np.float32)
        results = tuple(torch.from_numpy(array) for array in (drawing.image, drawing.transmittance, stacked, median))
        ctx.mark_non_differentiable(results[3])
        return results  # type: ignore[return-value]

    @staticmethod
    def backward(ctx: Any, *outer: Any) -> tuple[Any, ...]:
        splats, view, drawing, shown, settings = ctx.state
        d_image, d_transmittance = _gradient(outer[0], drawing.image), _gradient(outer[1], drawing.transmittance)
        moments = compiled.composite_backward(
            drawing, view, drawing.colours, drawing.background, d_image, d_transmittance
        )
        d_features = []
        for index, group in enumerate(shown):
            if outer[2] is None:
                break
            further = compiled.composite_backward(
                drawing,
                view,
                group,
                compiled.NO_BACKGROUND,
                _array(outer[2][index]),
                np.zeros_like(drawing.transmittance),
            )
            d_features.append(torch.from_numpy(compiled.sum_features(drawing, further)))
            moments[:, :6] += further[:, :6]
        found = compiled.splats_backward(splats, view, drawing, moments, settings.frames)
        if settings.screen_gradients is not None:
            settings.screen_gradients.copy_(torch.from_numpy(found.means))
        d_background = None
        if ctx.needs_input_grad[6]:
            d_background = torch.from_numpy((d_image * drawing.transmittance).sum(axis=(1, 2)))
        return (
            *(torch.from_numpy(gradient) for gradient in found.splats),
            torch.stack(d_features) if d_features else None,
            d_background,
            torch.from_numpy(found.camera_from_world),
            None,
        )
