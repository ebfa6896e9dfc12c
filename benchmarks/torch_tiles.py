"""Splats in plain torch, tile by tile: what one writes without a compiler, as the measure of the compiled kernels.

Projection is done at once for all splats, differentiated by torch; each tile of 16 x 16 pixels takes the splats whose
box touches it, near to far, and composites them in closed form, a matrix of splats by pixels.
"""

import torch
from torch import Tensor

from slideframe.products import Camera
from slideframe_gs_torch.reference import (
    LARGEST_ALPHA,
    LOW_PASS,
    NEAR,
    SMALLEST_ALPHA,
    projected_covariances,
    rotation_matrices,
)

TILE = 16


def draw_by_tiles(
    centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, camera: Camera
) -> Tensor:
    """Return the picture (height, width, 3) over black, seen from the origin along z."""
    kept = torch.nonzero(centers[:, 2] > NEAR)[:, 0]
    kept = kept[torch.argsort(centers[kept, 2], stable=True)]
    points = centers[kept]
    axes = rotation_matrices(rotations[kept]) * scales[kept, None, :]
    covariances = projected_covariances(points, axes @ axes.transpose(1, 2), camera) + LOW_PASS * torch.eye(2)
    focal = torch.tensor([camera.focal_x, camera.focal_y])
    means = points[:, :2] / points[:, 2:] * focal + torch.tensor([camera.principal_x, camera.principal_y])
    conics = torch.linalg.inv(covariances)
    opacities, colours = opacities[kept], colours[kept]
    reach = 2 * torch.log(opacities.detach() / SMALLEST_ALPHA).clamp_min(0)
    extents = (reach[:, None] * covariances.detach().diagonal(dim1=1, dim2=2)).sqrt()
    lowest, highest = means.detach() - extents, means.detach() + extents
    rows = []
    for top in range(0, camera.height, TILE):
        in_row = torch.nonzero((highest[:, 1] > top) & (lowest[:, 1] < top + TILE))[:, 0]
        tiles = []
        for left in range(0, camera.width, TILE):
            inside = in_row[(highest[in_row, 0] > left) & (lowest[in_row, 0] < left + TILE)]
            tiles.append(_tile(means[inside], conics[inside], opacities[inside], colours[inside], left, top))
        rows.append(torch.cat(tiles, dim=1))
    return torch.cat(rows)[: camera.height, : camera.width]


def _tile(means: Tensor, conics: Tensor, opacities: Tensor, colours: Tensor, left: int, top: int) -> Tensor:
    y, x = torch.meshgrid(torch.arange(TILE) + top + 0.5, torch.arange(TILE) + left + 0.5, indexing="ij")
    dx, dy = x.reshape(1, -1) - means[:, :1], y.reshape(1, -1) - means[:, 1:]
    power = -0.5 * (conics[:, :1, 0] * dx * dx + conics[:, 1:, 1] * dy * dy) - conics[:, :1, 1] * dx * dy
    alpha = (opacities[:, None] * power.exp()).clamp_max(LARGEST_ALPHA)
    alpha = torch.where(alpha >= SMALLEST_ALPHA, alpha, 0)
    passed = torch.cumprod(1 - alpha, dim=0)
    before = torch.cat([torch.ones_like(passed[:1]), passed[:-1]])
    return ((before * alpha).T @ colours).reshape(TILE, TILE, 3)
