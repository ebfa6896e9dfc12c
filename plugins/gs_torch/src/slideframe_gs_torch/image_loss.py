"""The reconstruction loss: L1 and SSIM."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from slideframe.arrays import Float32Array
from slideframe_gs_torch import image_loss_kernels as kernels
from slideframe_gs_torch.threads import run_shares


def image_loss(drawn: Tensor, truth: Tensor, ssim_weight: float) -> Tensor:
    """Return (1 - w) mean|drawn - truth| + w (1 - SSIM), differentiable in `drawn`; both (3, height, width), 0 to 1."""
    loss: Tensor = _ImageLoss.apply(drawn, truth, ssim_weight)  # type: ignore[no-untyped-call]
    return loss


def structural_similarity(drawn: Tensor, truth: Tensor) -> float:
    """Return the mean SSIM of two pictures (3, height, width)."""
    similarity, _, _ = _measure(drawn.numpy(), truth.numpy(), 1.0)
    return similarity


def _measure(drawn: Float32Array, truth: Float32Array, ssim_weight: float) -> tuple[float, float, Float32Array]:
    """Return SSIM, L1 and the gradient of their weighted loss."""
    drawn = np.ascontiguousarray(drawn, np.float32)
    channels, height, width = drawn.shape
    bordered = (channels, height + 2 * kernels.REACH, width)
    blurred, slopes = np.empty((5, *bordered), np.float32), np.empty((3, *bordered), np.float32)
    for planes in (blurred, slopes):
        planes[:, :, : kernels.REACH] = planes[:, :, -kernels.REACH :] = 0
    gradient = np.empty_like(drawn)
    similarity, difference = np.empty(drawn.shape[:2]), np.empty(drawn.shape[:2])
    rows = channels * height
    run_shares(kernels.blur_products, rows, drawn.size, drawn, truth, blurred)
    run_shares(kernels.compare, rows, drawn.size, blurred, slopes, similarity)
    run_shares(kernels.combine, rows, drawn.size, drawn, truth, slopes, ssim_weight, gradient, difference)
    return float(similarity.sum()) / drawn.size, float(difference.sum()) / drawn.size, gradient


class _ImageLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, drawn: Tensor, truth: Tensor, ssim_weight: float) -> Tensor:
        similarity, difference, gradient = _measure(drawn.detach().numpy(), truth.numpy(), ssim_weight)
        ctx.gradient = torch.from_numpy(gradient)
        return drawn.new_tensor((1 - ssim_weight) * difference + ssim_weight * (1 - similarity))

    @staticmethod
    def backward(ctx: Any, *outer: Any) -> tuple[Any, ...]:
        return outer[0] * ctx.gradient, None, None
