"""Splats through Warp: projection by torch, binning and compositing by kernels that need only a card's driver.

Not measured on a GPU. The kernels are compiled for one in the tests, and run on Warp's CPU device against the
reference.
"""

from functools import cache
from typing import Any, NamedTuple

import torch
import warp as wp
from torch import Tensor

from slideframe.arrays import Float32Array
from slideframe.products import Camera
from slideframe_gs_torch import warp_kernels as kernels
from slideframe_gs_torch.reference import (
    LOW_PASS,
    NEAR,
    SMALLEST_ALPHA,
    PlaneDrawing,
    projection_jacobian,
    rotation_matrices,
    seen_colours,
)

TILE = 16


class Screen(NamedTuple):
    """Splats as projected: see `projection_kernels`. Extents (splat, 2) are 0 for the invisible."""

    means: Tensor
    roots: Tensor
    opacities: Tensor
    extents: Tensor
    depths: Tensor


def draw_warp(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, features: Tensor,
    background: Tensor, camera_from_world: Tensor, camera: Camera, antialiased: bool,
    frame_rotations: Float32Array | None, screen_gradients: Tensor | None,
) -> PlaneDrawing:  # fmt: skip
    """Draw with Warp on the device of the tensors; arguments as in `rasterize`, features (group, splat, 3)."""
    start()
    pose = camera_from_world.to(centers.device, centers.dtype)
    screen = project(centers, rotations, scales, opacities, pose, camera, antialiased)
    lists = Lists.of(screen, camera)
    painted = [seen_colours(colours, centers, pose, frame_rotations), *features]
    drawn = [
        _Composite.apply(screen.means, screen.roots, screen.opacities, paint, lists, screen_gradients)  # type: ignore[no-untyped-call]
        for paint in painted
    ]
    image, transmittance, median = drawn[0]
    planes = [plane for plane, _, _ in drawn[1:]]
    stacked = torch.stack(planes) if planes else image.new_empty(0, *image.shape)
    return PlaneDrawing(image + background[:, None, None] * transmittance, transmittance, stacked, median.long())


def find_median(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, pose: Tensor, camera: Camera,
    antialiased: bool,
) -> Tensor:  # fmt: skip
    """Return the index of the splat behind which less than half of the light is left (height, width), or -1."""
    start()
    with torch.no_grad():
        screen = project(centers, rotations, scales, opacities, pose, camera, antialiased)
        lists = Lists.of(screen, camera)
        drawn = _Composite.apply(  # type: ignore[no-untyped-call]
            screen.means, screen.roots, screen.opacities, torch.zeros_like(centers), lists, None
        )
    return torch.as_tensor(drawn[2]).long()


@cache
def start() -> None:
    """Start Warp, which would otherwise greet on the terminal."""
    level = wp.config.log_level
    wp.config.log_level = wp.LOG_ERROR
    try:
        wp.init()  # type: ignore[no-untyped-call]
        wp.load_module(kernels, device="cuda" if torch.cuda.is_available() else "cpu")
    finally:
        wp.config.log_level = level


def project(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, pose: Tensor, camera: Camera,
    antialiased: bool,
) -> Screen:  # fmt: skip
    """Project splats (Zwicker et al. 2002), differentiated by torch."""
    points = centers @ pose[:, :3].T + pose[:, 3]
    depths = points[:, 2]
    # what lies behind the camera is put before it, finite, and then not drawn
    before = torch.cat([points[:, :2], depths.clamp_min(NEAR)[:, None]], dim=1)
    axes = pose[:, :3] @ (rotation_matrices(rotations) * scales[:, None, :])
    rows = projection_jacobian(before, camera) @ axes
    xx, xy, yy = (
        (rows[:, 0] * rows[:, 0]).sum(dim=1),
        (rows[:, 0] * rows[:, 1]).sum(dim=1),
        (rows[:, 1] * rows[:, 1]).sum(dim=1),
    )
    sharp = torch.linalg.cross(rows[:, 0], rows[:, 1]).square().sum(dim=1)
    determinant = sharp + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    if antialiased:
        opacities = opacities * (sharp.clamp_min(1e-30) / determinant).sqrt()
    roots = torch.stack([(yy / determinant).sqrt(), -xy / (yy * determinant).sqrt(), yy.rsqrt()], dim=1)
    focal, principal = (
        torch.tensor(pair, dtype=centers.dtype, device=centers.device)
        for pair in ((camera.focal_x, camera.focal_y), (camera.principal_x, camera.principal_y))
    )
    means = before[:, :2] / before[:, 2:] * focal + principal
    reach = 2 * (opacities.detach() / SMALLEST_ALPHA).clamp_min(1).log()
    extents = (reach[:, None] * torch.stack([xx, yy], dim=1).detach()).sqrt()
    visible = (depths > NEAR) & (opacities > SMALLEST_ALPHA)
    return Screen(means, roots, opacities, torch.where(visible[:, None], extents, 0), depths)


class Lists(NamedTuple):
    """Which splats each tile draws, near to far, and the size of the picture."""

    ranges: Tensor
    splats: Tensor
    height: int
    width: int

    @classmethod
    def of(cls, screen: Screen, camera: Camera) -> "Lists":
        """Sort the splats by tile and depth."""
        columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
        device = screen.means.device
        count = len(screen.means)
        ranges = torch.zeros(rows * columns, 2, dtype=torch.int32, device=device)
        if count == 0:
            return cls(ranges, torch.zeros(1, dtype=torch.int32, device=device), camera.height, camera.width)
        ranks = torch.empty(count, dtype=torch.int32, device=device)
        order = torch.argsort(screen.depths.detach(), stable=True)
        ranks[order] = torch.arange(count, dtype=torch.int32, device=device)
        means, extents = _vectors(screen.means, wp.vec2), _vectors(screen.extents, wp.vec2)
        counts = torch.empty(count, dtype=torch.int32, device=device)
        _launch(kernels.count_tiles, count, means, extents, columns, rows, _numbers(counts))
        ends = torch.cumsum(counts, dim=0, dtype=torch.int32)
        total = int(ends[-1])
        # the sort wants room for two
        keys = torch.zeros(2 * max(total, 1), dtype=torch.int64, device=device)
        splats = torch.zeros(2 * max(total, 1), dtype=torch.int32, device=device)
        inputs = means, extents, _numbers(ranks), columns, rows, _numbers(ends), _numbers(counts)
        _launch(kernels.list_tiles, count, *inputs, _numbers(keys), _numbers(splats))
        if total:
            wp.utils.radix_sort_pairs(_numbers(keys), _numbers(splats), total)
            _launch(kernels.find_tiles, total, _numbers(keys), total, _vectors(ranges, wp.vec2i))
        return cls(ranges, splats, camera.height, camera.width)


def _launch(kernel: Any, size: int | tuple[int, int], *inputs: Any) -> None:
    arrays = [value for value in inputs if isinstance(value, wp.array)]
    wp.launch(kernel, dim=size, inputs=list(inputs), device=arrays[0].device)


def _numbers(tensor: Tensor) -> Any:
    return wp.from_torch(tensor.detach().contiguous())


def _vectors(tensor: Tensor, kind: Any) -> Any:
    return wp.from_torch(tensor.detach().contiguous(), dtype=kind)


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, Tensor, Tensor]:
        means, roots, opacities, paint, lists, screen_gradients = arguments
        size = lists.height, lists.width
        image = paint.new_zeros(*size, 3)
        transmittance = paint.new_ones(size)
        ends, median = (torch.full(size, -1, dtype=torch.int32, device=paint.device) for _ in range(2))
        _launch(
            kernels.composite, size, *_inputs(means, roots, opacities, paint, lists),
            _vectors(image, wp.vec3), _numbers(transmittance), _numbers(ends), _numbers(median),
        )  # fmt: skip
        ctx.save_for_backward(means, roots, opacities, paint, transmittance, ends)
        ctx.lists, ctx.screen_gradients = lists, screen_gradients
        ctx.mark_non_differentiable(median)
        return image.permute(2, 0, 1), transmittance, median

    @staticmethod
    def backward(ctx: Any, *outer: Any) -> tuple[Any, ...]:
        means, roots, opacities, paint, transmittance, ends = ctx.saved_tensors
        found = [torch.zeros_like(tensor) for tensor in (means, roots, opacities, paint, means)]
        kinds = wp.vec2, wp.vec3, None, wp.vec3, wp.vec2
        _launch(
            kernels.composite_backward, tuple(transmittance.shape), *_inputs(means, roots, opacities, paint, ctx.lists),
            _numbers(transmittance), _numbers(ends),
            _vectors(outer[0].permute(1, 2, 0), wp.vec3), _numbers(outer[1]),
            *(_vectors(tensor, kind) if kind else _numbers(tensor) for tensor, kind in zip(found, kinds, strict=True)),
        )  # fmt: skip
        if ctx.screen_gradients is not None:
            ctx.screen_gradients.add_(found[4])
        return *found[:4], None, None


def _inputs(means: Tensor, roots: Tensor, opacities: Tensor, paint: Tensor, lists: Lists) -> tuple[Any, ...]:
    return (
        -(-lists.width // TILE),
        _vectors(means, wp.vec2),
        _vectors(roots, wp.vec3),
        _numbers(opacities),
        _vectors(paint, wp.vec3),
        _vectors(lists.ranges, wp.vec2i),
        _numbers(lists.splats),
    )
