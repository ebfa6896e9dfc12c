"""The deformation that the renderer's splats follow."""

import warp as wp

from .materials import SMALLEST_SQUARED_STRETCH
from .reals import Matrix, Real, Vector
from .tensors import symmetric_eigen, with_eigenvalues

wp.set_module_options({"enable_backward": False})


@wp.kernel
def bound_stretch(first: int, deformation_gradients: wp.array(dtype=Matrix), low: Real, high: Real, sweeps: int):
    """Hold the principal stretches of the rendering frames between two bounds: F <- F V diag(s' / s) V^T."""
    particle = first + wp.tid()
    gradient = deformation_gradients[particle]
    square = wp.transpose(gradient) * gradient
    excess = square - wp.identity(3, dtype=Real)
    # no eigenvalue of F^T F is further from 1 than |F^T F - 1|
    reach = wp.min(Real(1.0) - low * low, high * high - Real(1.0))
    if wp.ddot(excess, excess) < reach * reach:
        return
    squared, vectors = symmetric_eigen(square, sweeps)
    ratio = Vector()
    changed = 0
    for axis in range(3):
        stretch = wp.sqrt(wp.max(squared[axis], SMALLEST_SQUARED_STRETCH))
        ratio[axis] = wp.clamp(stretch, low, high) / stretch
        if ratio[axis] != Real(1.0):
            changed = 1
    if changed == 1:
        deformation_gradients[particle] = gradient * with_eigenvalues(ratio, vectors)
