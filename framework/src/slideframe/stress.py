"""Stress invariants of particles, for frames that carry them."""

from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.problem import Material, SimulationProblem

# Eigenvalues of b_e below this are lifted to it, so that a crushed particle has a logarithm.
SMALLEST_SQUARED_STRETCH = 1e-12


def stress_fields(
    elastic_states: Float64Array, plastic_strains: npt.NDArray[np.floating], problem: SimulationProblem
) -> dict[str, Any]:
    """Return a frame's fields of stress and plastic strain by name, or none where the problem doesn't ask for them.

    Args:
        elastic_states: X = b_e - 1, elastic left Cauchy-Green tensor minus identity, (n, 3, 3).
        plastic_strains: accumulated norm of the plastic deviatoric strain, (n,).
        problem: says whether stress is recorded, and the material.
    """
    if not problem.simulation.record_stress:
        return {}
    mean, deviatoric = stress_invariants(elastic_states, problem.material)
    fields = {"mean_stresses": mean, "deviatoric_stresses": deviatoric, "plastic_strains": plastic_strains}
    return {name: values.astype(np.float32) for name, values in fields.items()}


def symmetric(components: npt.NDArray[np.floating]) -> Float64Array:
    """Return symmetric matrices (n, 3, 3) of their components (xx, yy, zz, yz, xz, xy), (n, 6)."""
    return components[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]].astype(np.float64)


def stress_invariants(elastic_states: Float64Array, material: Material) -> tuple[Float64Array, Float64Array]:
    """Return mean stress tr(sigma) / 3 and deviatoric stress q = sqrt(3 J2), Pa, of X = b_e - 1 (n, 3, 3).

    Tension is positive; q is |sigma_1 - sigma_3| in a triaxial test. Cauchy's stress is Kirchhoff's, linear in
    Hencky strain, over the elastic change of volume.
    """
    squared = np.linalg.eigvalsh(elastic_states)
    strain = 0.5 * np.log1p(np.maximum(squared, SMALLEST_SQUARED_STRETCH - 1))
    trace = strain.sum(axis=1)
    deviator = np.linalg.norm(strain - trace[:, None] / 3, axis=1)
    volume = np.exp(trace)
    mean: Float64Array = material.bulk_modulus * trace / volume
    deviatoric: Float64Array = np.sqrt(6.0) * material.shear_modulus * deviator / volume
    return mean, deviatoric
