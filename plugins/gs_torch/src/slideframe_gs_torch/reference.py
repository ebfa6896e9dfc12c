"""The rasteriser as its formulas read: every splat at every pixel, in torch, differentiated by torch.

Kerbl et al. 2023 with nothing left out for speed but far tiles: slow, of any precision, and the measure
of the compiled kernels. It shares no code with them.
"""

import torch
from torch import Tensor

from slideframe.arrays import Float64Array
from slideframe.products import Camera

NEAR = 0.2
LOW_PASS = 0.3
FRUSTUM_MARGIN = 0.3
SMALLEST_ALPHA = 1 / 255
LARGEST_ALPHA = 0.99
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


def projected_covariances(points: Tensor, covariances: Tensor, camera: Camera) -> Tensor:
    """Return (splat, 2, 2), px^2, of covariances (splat, 3, 3) in camera axes, low-passed."""
    x, y, z = points.unbind(1)
    margin_x = FRUSTUM_MARGIN * camera.width / (2 * camera.focal_x)
    margin_y = FRUSTUM_MARGIN * camera.height / (2 * camera.focal_y)
    low_x, high_x = -camera.principal_x / camera.focal_x, (camera.width - camera.principal_x) / camera.focal_x
    low_y, high_y = -camera.principal_y / camera.focal_y, (camera.height - camera.principal_y) / camera.focal_y
    slope_x = (x / z).clamp(low_x - margin_x, high_x + margin_x)
    slope_y = (y / z).clamp(low_y - margin_y, high_y + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([camera.focal_x / z, zero, -camera.focal_x * slope_x / z], dim=1),
            torch.stack([zero, camera.focal_y / z, -camera.focal_y * slope_y / z], dim=1),
        ],
        dim=1,
    )
    return jacobian @ covariances @ jacobian.transpose(1, 2) + LOW_PASS * torch.eye(2, dtype=points.dtype)


def composite_exactly(
    centers: Tensor,
    rotations: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colours: Tensor,
    camera: Camera,
    camera_from_world: Float64Array,
) -> tuple[Tensor, Tensor]:
    """Return red, green, blue, depth (4, height, width) without background, and the transmittance (height, width)."""
    pose = torch.as_tensor(camera_from_world, dtype=centers.dtype)
    points = centers @ pose[:, :3].T + pose[:, 3]
    kept = torch.nonzero(points[:, 2] > NEAR)[:, 0]
    kept = kept[torch.argsort(points[kept, 2], stable=True)]
    points = points[kept]
    axes = pose[:, :3] @ (rotation_matrices(rotations[kept]) * scales[kept, None, :])
    conics = torch.linalg.inv(projected_covariances(points, axes @ axes.transpose(1, 2), camera))
    focal = torch.tensor([camera.focal_x, camera.focal_y], dtype=centers.dtype)
    principal = torch.tensor([camera.principal_x, camera.principal_y], dtype=centers.dtype)
    means = points[:, :2] / points[:, 2:] * focal + principal
    features = torch.cat([colours[kept], points[:, 2:]], dim=1)
    bands = [
        _composite_band(
            means, conics, opacities[kept], features, camera.width, top, min(top + ROWS_AT_ONCE, camera.height)
        )
        for top in range(0, camera.height, ROWS_AT_ONCE)
    ]
    planes, transmittance = (torch.cat(parts, dim=-2) for parts in zip(*bands, strict=True))
    return planes, transmittance


def _composite_band(
    means: Tensor, conics: Tensor, opacities: Tensor, features: Tensor, width: int, top: int, bottom: int
) -> tuple[Tensor, Tensor]:
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
    planes = torch.einsum("nhw,nc->chw", before * alpha, features)
    return planes, passed[-1] if len(passed) else torch.ones((len(rows), width), dtype=means.dtype)
