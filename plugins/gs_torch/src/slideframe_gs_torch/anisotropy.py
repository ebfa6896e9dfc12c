"""Low anisotropy (Liang & Cheng 2026, section 3.2): its loss, its measure and its strict form at export."""

import math

import numpy as np
from torch import Tensor

from slideframe.arrays import Float32Array

# The ratio is exact up to here and linear in log-scale beyond: at 1e20 its gradient would be no number.
LARGEST_EXACT_RATIO = 100.0
# Room for the rounding of float32 logarithms in files, so that the limit holds for whoever reads them.
EXPORT_MARGIN = 1e-5


def anisotropy_loss(log_scales: Tensor, limit: float) -> Tensor:
    """Return mean(max(s_max / s_min, r) - r) over the splats.

    With d = log s_max - log s_min the ratio is exp(d); above LARGEST_EXACT_RATIO it goes on as the
    tangent of exp, which keeps value and slope continuous and the gradient finite. Training steps along its gradient in
    a kernel (`optimiser_kernels.add_shape_gradient`), which is held to this.

    Args:
        log_scales: (splat, 3).
        limit: r, above 1.
    """
    spread = log_scales.amax(dim=1) - log_scales.amin(dim=1)
    bend = math.log(LARGEST_EXACT_RATIO)
    ratio = spread.clamp_max(bend).exp() + LARGEST_EXACT_RATIO * (spread - bend).clamp_min(0)
    return (ratio - limit).clamp_min(0).mean()


def share_above(scales: Float32Array, limit: float) -> float:
    """Return the share of splats (splat, 3) whose ratio of scales is above the limit."""
    return float(np.mean(scales.max(axis=1) > limit * scales.min(axis=1))) if len(scales) else 0.0


def project_scales(scales: Float32Array, limit: float) -> Float32Array:
    """Return scales (splat, 3) with no ratio above the limit.

    The window of allowed sizes is centred, in logarithms, between the splat's largest and smallest:
    the long axis shrinks as much as the short one grows. Splats within the limit keep their bits.
    """
    logarithms = np.log(scales.astype(np.float64))
    low, high = logarithms.min(axis=1, keepdims=True), logarithms.max(axis=1, keepdims=True)
    half = (math.log(limit) - EXPORT_MARGIN) / 2
    middle = (low + high) / 2
    projected = np.exp(logarithms.clip(middle - half, middle + half)).astype(np.float32)
    return np.where(high - low > 2 * half, projected, scales)
