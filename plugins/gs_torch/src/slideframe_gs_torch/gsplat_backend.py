"""Splats through gsplat (Ye et al. 2024) on a CUDA card.

Not measured on a GPU. Its kernels are its own; the tests hold what is handed to them against the documented contract
of `gsplat.rasterization`.
"""

import torch
from torch import Tensor

from slideframe.arrays import Float32Array
from slideframe.products import Camera
from slideframe_gs_torch.reference import LOW_PASS, NEAR, PlaneDrawing, seen_colours


def draw_gsplat(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, features: Tensor,
    background: Tensor, camera_from_world: Tensor, camera: Camera, antialiased: bool,
    frame_rotations: Float32Array | None, screen_gradients: Tensor | None,
) -> PlaneDrawing:  # fmt: skip
    """Draw with gsplat; arguments as in `rasterize`, features (group, splat, 3).

    gsplat has no median depth, so where features are asked for Warp's kernels find it.
    """
    from gsplat import rasterization

    pose = camera_from_world.to(centers.dtype)
    paint = torch.cat([seen_colours(colours, centers, pose, frame_rotations), *features], dim=1)
    behind = torch.cat([background, background.new_zeros(paint.shape[1] - 3)])
    bottom = pose.new_tensor([[0.0, 0.0, 0.0, 1.0]])
    lens = pose.new_tensor(
        [[camera.focal_x, 0, camera.principal_x], [0, camera.focal_y, camera.principal_y], [0, 0, 1]]
    )
    drawn, alphas, meta = rasterization(
        centers, torch.nn.functional.normalize(rotations, dim=1), scales, opacities, paint,
        viewmats=torch.cat([pose, bottom])[None], Ks=lens[None], width=camera.width, height=camera.height,
        near_plane=NEAR, eps2d=LOW_PASS, packed=False, backgrounds=behind[None], absgrad=screen_gradients is not None,
        rasterize_mode="antialiased" if antialiased else "classic",
    )  # fmt: skip
    if screen_gradients is not None and meta["means2d"].requires_grad:
        means = meta["means2d"]
        # the kernels leave |dL/dmean| there just before this gradient is handed on
        means.register_hook(lambda _: screen_gradients.copy_(means.absgrad[0]))
    planes = drawn[0].permute(2, 0, 1)
    median = centers.new_full((0, 0), -1, dtype=torch.long)
    if len(features):
        from slideframe_gs_torch.warp_backend import find_median

        median = find_median(centers, rotations, scales, opacities, pose, camera, antialiased)
    groups = planes[3:].reshape(len(features), 3, camera.height, camera.width)
    return PlaneDrawing(planes[:3], 1 - alphas[0, :, :, 0], groups, median)


def draw_one_splat(device: torch.device) -> None:
    """Draw and differentiate one splat, or raise whatever keeps gsplat from it."""
    camera = Camera(width=16, height=16, focal_x=16, focal_y=16, principal_x=8, principal_y=8)
    center = torch.tensor([[0.0, 0.0, 2.0]], device=device, requires_grad=True)
    one, pose = torch.ones(1, device=device), torch.eye(3, 4, device=device)
    drawing = draw_gsplat(
        center, one.new_tensor([[1.0, 0, 0, 0]]), one.new_full((1, 3), 0.1), one / 2, one.new_ones(1, 3),
        one.new_empty(0, 1, 3), one.new_zeros(3), pose, camera, False, None, None,
    )  # fmt: skip
    drawing.image.sum().backward()  # type: ignore[no-untyped-call]
