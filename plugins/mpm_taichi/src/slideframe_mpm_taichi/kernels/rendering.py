"""The deformation that the renderer's splats follow."""

import taichi as ti

from .arrays import Array
from .materials import SMALLEST_SQUARED_STRETCH
from .tensors import symmetric_eigen, with_eigenvalues


@ti.kernel
def bound_stretch(deformation_gradients: Array, low: float, high: float):
    """Hold the principal stretches of the rendering frames between two bounds: F <- F V diag(s' / s) V^T."""
    for particle in range(deformation_gradients.shape[0]):
        gradient = deformation_gradients[particle]
        squared, vectors = symmetric_eigen(gradient.transpose() @ gradient)
        stretches = ti.sqrt(ti.max(squared, SMALLEST_SQUARED_STRETCH))
        ratios = ti.min(ti.max(stretches, low), high) / stretches
        if (ratios != 1.0).any():
            deformation_gradients[particle] = gradient @ with_eigenvalues(ratios, vectors)
