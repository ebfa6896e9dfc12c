"""The deformation that the renderer's splats follow."""

import taichi as ti

from .arrays import Array
from .materials import SMALLEST_SQUARED_STRETCH
from .tensors import pack, sphere, squared_norm, symmetric_eigen, with_eigenvalues


@ti.kernel
def bound_stretch(deformation_gradients: Array, low: float, high: float):
    """Hold the principal stretches of the rendering frames between two bounds: F <- F V diag(s' / s) V^T."""
    # no eigenvalue of F^T F is further from 1 than |F^T F - 1|
    reach = ti.min(1.0 - low * low, high * high - 1.0)
    for particle in range(deformation_gradients.shape[0]):
        gradient = deformation_gradients[particle]
        square = gradient.transpose() @ gradient
        # written so that NaN, too, is looked at
        if not (squared_norm(pack(square - sphere(1.0))) < reach * reach):
            squared, vectors = symmetric_eigen(square)
            stretches = ti.sqrt(ti.max(squared, SMALLEST_SQUARED_STRETCH))
            ratios = ti.min(ti.max(stretches, low), high) / stretches
            if (ratios != 1.0).any():
                deformation_gradients[particle] = gradient @ with_eigenvalues(ratios, vectors)
