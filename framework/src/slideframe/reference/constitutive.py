"""Drucker-Prager sand with Hencky elasticity, particle by particle, in float64.

The law is that of Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation", with the
volume correction of Tampubolon et al. 2017, "Multi-species simulation of porous sand and water
mixtures", sect. 4.3. Tension is positive.
"""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Sand

# Singular values below this are lifted to it, so that an inverted or crushed particle has a logarithm.
SMALLEST_STRETCH = 1e-6


def hencky_strain(deformation_gradient: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return U (n, 3, 3), the principal Hencky strains log(sigma) (n, 3) and V^T (n, 3, 3) of F (n, 3, 3)."""
    left, stretches, right = np.linalg.svd(deformation_gradient)
    return left, np.log(np.maximum(stretches, SMALLEST_STRETCH)), right


def kirchhoff_stress(deformation_gradient: Float64Array, sand: Sand) -> Float64Array:
    """Return tau = U (2 mu eps + lambda tr(eps) 1) U^T (n, 3, 3), Pa (Klar et al. 2016, sect. 6.2)."""
    left, strain, _ = hencky_strain(deformation_gradient)
    principal = 2 * sand.shear_modulus * strain + sand.lame_lambda * strain.sum(axis=1, keepdims=True)
    stress: Float64Array = (left * principal[:, None, :]) @ np.swapaxes(left, 1, 2)
    return stress


def return_mapping(
    deformation_gradient: Float64Array, volume_correction: Float64Array, sand: Sand
) -> tuple[Float64Array, Float64Array]:
    """Return the elastic deformation gradient (n, 3, 3) and volume correction (n,) after plastic flow.

    `volume_correction` is the log of the expansion that happened without stress; compression uses it
    up before it meets resistance. States inside the cone come back bit for bit.

    Source: Klar et al. 2016, eqs. 27 to 29; Tampubolon et al. 2017, eqs. 29 to 31.
    """
    left, strain, right = hencky_strain(deformation_gradient)
    strain = strain + volume_correction[:, None] / 3
    trace = strain.sum(axis=1)
    deviator = strain - trace[:, None] / 3
    norm = np.linalg.norm(deviator, axis=1)
    excess = norm + cone_slope(sand) * trace
    apex = trace >= 0
    cone = ~apex & (excess > 0)

    kept = np.where(cone, 1 - excess / np.where(cone, norm, 1.0), 1.0)
    projected = np.where(apex[:, None], 0.0, kept[:, None] * deviator + trace[:, None] / 3)
    rebuilt = (left * np.exp(projected)[:, None, :]) @ right
    # at the apex b_e = 1; any rotation serves, and the unit matrix forgets the rounding of U V^T
    rebuilt[apex] = np.eye(3)
    elastic = ~apex & ~cone & (volume_correction == 0)
    result = np.where(elastic[:, None, None], deformation_gradient, rebuilt)
    return result, np.where(apex, trace, 0.0)


def cone_slope(sand: Sand) -> float:
    """Return (3 lambda + 2 mu) / (2 mu) alpha: the deviatoric Hencky strain that the cone allows per compression."""
    mu = sand.shear_modulus
    return (3 * sand.lame_lambda + 2 * mu) / (2 * mu) * sand.friction_coefficient
