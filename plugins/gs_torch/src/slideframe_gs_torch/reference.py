"""The rasteriser as its formulas read: every splat at every pixel, in torch, differentiated by torch.

Kerbl et al. 2023 with nothing left out for speed but far tiles: slow, of any precision, and the measure
of the compiled kernels. It shares no code with them.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from slideframe.arrays import Float32Array
from slideframe.products import Camera
from slideframe_gs_torch.harmonics import evaluate_harmonics

NEAR = 0.2
LOW_PASS = 0.3
FRUSTUM_MARGIN = 0.3
SMALLEST_ALPHA = 1 / 255
LARGEST_ALPHA = 0.99
MEDIAN_TRANSMITTANCE = 0.5
ROWS_AT_ONCE = 16


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Return (splat, 3, 3) from quaternions wxyz (splat, 4) of any length."""
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=1).unbind(1)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)


def projection_jacobian(points: Tensor, camera: Camera) -> Tensor:
    """Return (splat, 2, 3), px/m, of pixels by points (splat, 3) in camera axes, in the widened frustum."""
    x, y, z = points.unbind(1)
    margin_x = FRUSTUM_MARGIN * camera.width / (2 * camera.focal_x)
    margin_y = FRUSTUM_MARGIN * camera.height / (2 * camera.focal_y)
    low_x, high_x = -camera.principal_x / camera.focal_x, (camera.width - camera.principal_x) / camera.focal_x
    low_y, high_y = -camera.principal_y / camera.focal_y, (camera.height - camera.principal_y) / camera.focal_y
    slope_x = (x / z).clamp(low_x - margin_x, high_x + margin_x)
    slope_y = (y / z).clamp(low_y - margin_y, high_y + margin_y)
    zero = torch.zeros_like(z)
    return torch.stack(
        [
            torch.stack([camera.focal_x / z, zero, -camera.focal_x * slope_x / z], dim=1),
            torch.stack([zero, camera.focal_y / z, -camera.focal_y * slope_y / z], dim=1),
        ],
        dim=1,
    )


def projected_covariances(points: Tensor, covariances: Tensor, camera: Camera) -> Tensor:
    """Return (splat, 2, 2), px^2, of covariances (splat, 3, 3) in camera axes."""
    jacobian = projection_jacobian(points, camera)
    return jacobian @ covariances @ jacobian.transpose(1, 2)


class PlaneDrawing(NamedTuple):
    """What a backend draws.

    Attributes:
        image: (3, height, width), over the background.
        transmittance: (height, width).
        planes: (group, 3, height, width), of what else each splat shows.
        median: (height, width), the index of the splat behind which less than half of the light is left, or -1;
            empty without groups.
    """

    image: Tensor
    transmittance: Tensor
    planes: Tensor
    median: Tensor


def camera_from(world_from_camera: Tensor) -> Tensor:
    """Return the inverse of a pose (3, 4) whose rotation is orthonormal."""
    turned = world_from_camera[:, :3].T
    return torch.cat([turned, -turned @ world_from_camera[:, 3:]], dim=1)


def seen_colours(colours: Tensor, centers: Tensor, pose: Tensor, frame_rotations: Float32Array | None) -> Tensor:
    """Return colours (splat, 3) from colours or harmonics."""
    if colours.ndim == 2:
        return colours
    directions = centers + (pose[:, :3].T @ pose[:, 3])
    if frame_rotations is not None:
        # d^T R = (R^T d)^T
        turned = torch.as_tensor(frame_rotations, dtype=directions.dtype, device=directions.device)
        directions = (directions[:, None, :] @ turned)[:, 0]
    return evaluate_harmonics(colours, directions)


def composite_exactly(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, features: Tensor,
    background: Tensor, camera_from_world: Tensor, camera: Camera, antialiased: bool,
    frame_rotations: Float32Array | None, screen_gradients: Tensor | None = None,
) -> PlaneDrawing:  # fmt: skip
    """Draw; arguments as in `rasterize`, features (group, splat, 3); `screen_gradients` are left alone."""
    pose = camera_from_world.to(centers.dtype)
    points = centers @ pose[:, :3].T + pose[:, 3]
    kept = torch.nonzero(points[:, 2] > NEAR)[:, 0]
    kept = kept[torch.argsort(points[kept, 2], stable=True)]
    points = points[kept]
    axes = pose[:, :3] @ (rotation_matrices(rotations[kept]) * scales[kept, None, :])
    sharp = projected_covariances(points, axes @ axes.transpose(1, 2), camera)
    blurred = sharp + LOW_PASS * torch.eye(2, dtype=points.dtype)
    opacities = opacities[kept]
    if antialiased:
        opacities = opacities * (torch.linalg.det(sharp) / torch.linalg.det(blurred)).clamp_min(0).sqrt()
    focal = torch.tensor([camera.focal_x, camera.focal_y], dtype=centers.dtype)
    principal = torch.tensor([camera.principal_x, camera.principal_y], dtype=centers.dtype)
    means = points[:, :2] / points[:, 2:] * focal + principal
    painted = seen_colours(colours, centers, pose, frame_rotations)[kept]
    paint = torch.cat([painted, *(group[kept] for group in features)], dim=1)
    bands = [
        _composite_band(
            means,
            torch.linalg.inv(blurred),
            opacities,
            paint,
            camera.width,
            top,
            min(top + ROWS_AT_ONCE, camera.height),
        )
        for top in range(0, camera.height, ROWS_AT_ONCE)
    ]
    planes, transmittance, median = (torch.cat(parts, dim=-2) for parts in zip(*bands, strict=True))
    median = torch.where(median >= 0, kept[median.clamp_min(0)], -1) if len(kept) else median
    image = planes[:3] + background[:, None, None] * transmittance
    return PlaneDrawing(image, transmittance, planes[3:].reshape(len(features), 3, *transmittance.shape), median)


def _composite_band(
    means: Tensor, conics: Tensor, opacities: Tensor, paint: Tensor, width: int, top: int, bottom: int
) -> tuple[Tensor, Tensor, Tensor]:
    rows = torch.arange(top, bottom, dtype=means.dtype) + 0.5
    columns = torch.arange(width, dtype=means.dtype) + 0.5
    dy = rows[None, :, None] - means[:, 1, None, None]
    dx = columns[None, None, :] - means[:, 0, None, None]
    a, b, c = conics[:, 0, 0, None, None], conics[:, 0, 1, None, None], conics[:, 1, 1, None, None]
    alpha = opacities[:, None, None] * torch.exp(-0.5 * (a * dx * dx + 2 * b * dx * dy + c * dy * dy))
    alpha = alpha.clamp_max(LARGEST_ALPHA)
    alpha = torch.where(alpha >= SMALLEST_ALPHA, alpha, torch.zeros_like(alpha))
    passed = torch.cumprod(1 - alpha, dim=0)
    before = torch.cat([torch.ones_like(passed[:1]), passed[:-1]])
    planes = torch.einsum("nhw,nc->chw", before * alpha, paint)
    if not len(passed):
        clear = torch.ones((len(rows), width), dtype=means.dtype)
        return planes, clear, torch.full(clear.shape, -1)
    reached = passed <= MEDIAN_TRANSMITTANCE
    return planes, passed[-1], torch.where(reached.any(dim=0), reached.int().argmax(dim=0), -1)
