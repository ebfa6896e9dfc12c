"""The laws of the soil with Hencky elasticity, particle by particle, in float64.

The cone is that of Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation", with the
volume correction of Tampubolon et al. 2017, "Multi-species simulation of porous sand and water
mixtures", sect. 4.3; the pyramid is Mohr-Coulomb's. Tension is positive. Principal strains descend.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.problem import LawConstants
from slideframe.problem.material import ElasticSoil

# Singular values below this are lifted to it, so that an inverted or crushed particle has a logarithm.
SMALLEST_STRETCH = 1e-6

# A plane of the pyramid counts as obeyed within this share of the trial stress.
PLANE_TOLERANCE = 1e-12


class PlasticFlow(NamedTuple):
    """What a return mapping leaves.

    Attributes:
        elastic: (n, 3, 3), elastic deformation gradient.
        volume_correction: (n,), log of the expansion that happened without stress.
        sheared: (n,), growth of the norm of plastic deviatoric strain.
    """

    elastic: Float64Array
    volume_correction: Float64Array
    sheared: Float64Array


def hencky_strain(deformation_gradient: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return U (n, 3, 3), the principal Hencky strains log(sigma) (n, 3) and V^T (n, 3, 3) of F (n, 3, 3)."""
    left, stretches, right = np.linalg.svd(deformation_gradient)
    return left, np.log(np.maximum(stretches, SMALLEST_STRETCH)), right


def kirchhoff_stress(deformation_gradient: Float64Array, soil: ElasticSoil) -> Float64Array:
    """Return tau = U (2 mu eps + lambda tr(eps) 1) U^T (n, 3, 3), Pa (Klar et al. 2016, sect. 6.2)."""
    left, strain, _ = hencky_strain(deformation_gradient)
    principal = 2 * soil.shear_modulus * strain + soil.lame_lambda * strain.sum(axis=1, keepdims=True)
    stress: Float64Array = (left * principal[:, None, :]) @ np.swapaxes(left, 1, 2)
    return stress


def return_mapping(
    deformation_gradient: Float64Array, volume_correction: Float64Array, soil: ElasticSoil
) -> PlasticFlow:
    """Return the state after plastic flow of trial states F (n, 3, 3) with volume corrections (n,).

    `volume_correction` is the log of the expansion that happened without stress; compression uses it
    up before it meets resistance. States inside the yield surface come back bit for bit.
    """
    if soil.law == "elastic":
        return PlasticFlow(deformation_gradient, volume_correction, np.zeros(len(volume_correction)))
    left, trial, right = hencky_strain(deformation_gradient)
    used = np.clip(-trial.sum(axis=1), 0, volume_correction)
    trial = trial + used[:, None] / 3
    law = _to_pyramid if soil.law == "mohr_coulomb" else _to_cone
    strain, opened = law(trial, soil.constants)
    changed = (used > 0) | (strain != trial).any(axis=1)
    rebuilt = (left * np.exp(strain)[:, None, :]) @ right
    # without strain b_e = 1; any rotation serves, and the unit matrix forgets the rounding of U V^T
    rebuilt[(strain == 0).all(axis=1)] = np.eye(3)
    moved = trial - strain
    return PlasticFlow(
        elastic=np.where(changed[:, None, None], rebuilt, deformation_gradient),
        volume_correction=volume_correction - used + soil.constants.keeps_expansion * opened,
        sheared=np.linalg.norm(moved - moved.mean(axis=1, keepdims=True), axis=1),
    )


def _to_cone(trial: Float64Array, soil: LawConstants) -> tuple[Float64Array, Float64Array]:
    """Return principal strains (n, 3) on or within the cone and its cut-off, and the expansion (n,) given up there.

    Source: Klar et al. 2016, eqs. 27 to 29, with the apex moved by cohesion, flow that dilates, and a plane of
    constant mean stress across the tip.
    """
    trace = trial.sum(axis=1)
    deviator = trial - trace[:, None] / 3
    norm = np.linalg.norm(deviator, axis=1)
    flow = np.maximum(norm + soil.cone_slope * (trace - soil.apex), 0) / (1 + soil.cone_slope * soil.dilation)
    onto_cone, dilated = norm - flow, trace - soil.dilation * flow
    cut = dilated > soil.cutoff
    left = np.where(cut, np.minimum(norm, soil.cone_slope * (soil.apex - soil.cutoff)), onto_cone)
    kept = np.divide(left, norm, out=np.ones_like(norm), where=norm > 0)
    mapped = kept[:, None] * deviator + np.where(cut, soil.cutoff, dilated)[:, None] / 3
    yields = cut | (flow > 0)
    return np.where(yields[:, None], mapped, trial), np.where(cut, trace - soil.cutoff, 0.0)


def _to_pyramid(trial: Float64Array, soil: LawConstants) -> tuple[Float64Array, Float64Array]:
    """Return principal strains (n, 3) on or within Mohr-Coulomb's pyramid, and the expansion (n,) given up.

    Rankine's cut-off comes first; the return to the pyramid lowers the largest stress, so that it holds after both.
    """
    s, d = soil.sine_friction, soil.sine_dilatancy
    # planes of one sextant: which pairs of principal stresses slip on one another
    normals = np.array([[1 + s, 0, s - 1], [1 + s, s - 1, 0], [0, 1 + s, s - 1]])
    flows = np.array([[1 + d, 0, d - 1], [1 + d, d - 1, 0], [0, 1 + d, d - 1]])
    cut = _return_to_planes(trial, np.eye(3), np.eye(3), np.full(3, soil.cutoff), soil, ((0,), (0, 1), (0, 1, 2)))
    mapped = _return_to_planes(cut, normals, flows, np.full(3, soil.cohesion), soil, ((0,), (0, 1), (0, 2)))
    lost = np.isnan(mapped).any(axis=1)
    mapped[lost] = soil.apex / 3
    opened = np.where(lost, np.maximum(trial.sum(axis=1) - soil.apex, 0), trial.sum(axis=1) - cut.sum(axis=1))
    return mapped, opened


def _return_to_planes(
    trial: Float64Array,
    normals: Float64Array,
    flows: Float64Array,
    limits: Float64Array,
    soil: LawConstants,
    active_sets: tuple[tuple[int, ...], ...],
) -> Float64Array:
    """Return strains (n, 3) that obey every plane normal . stress <= limit, by Koiter's rule; NaN where no set serves.

    Stresses are in 2 mu. The first of the sets of planes whose multipliers aren't negative and whose result
    violates no plane is the one that is active.
    """
    stiffness = np.eye(3) + soil.lame_lambda / (2 * soil.shear_modulus)
    scale = np.abs(trial @ stiffness).max(axis=1) + np.abs(limits).min()

    def violated(strain: Float64Array) -> npt.NDArray[np.bool_]:
        over = strain @ stiffness @ normals.T - limits
        beyond: npt.NDArray[np.bool_] = (over > PLANE_TOLERANCE * scale[:, None]).any(axis=1)
        return beyond

    open_cases = violated(trial)
    mapped = np.where(open_cases[:, None], np.nan, trial)
    for active in map(list, active_sets):
        over = trial @ stiffness @ normals[active].T - limits[active]
        multipliers = np.linalg.solve(normals[active] @ stiffness @ flows[active].T, over.T).T
        strain = trial - multipliers @ flows[active]
        serves = (
            open_cases
            & (multipliers >= 0).all(axis=1)
            & ~violated(strain)
            & (np.diff(strain) <= PLANE_TOLERANCE * scale[:, None]).all(axis=1)
        )
        mapped[serves] = strain[serves]
        open_cases &= ~serves
    return mapped
