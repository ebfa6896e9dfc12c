"""Stress that the soil has before it moves."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import SimulationProblem
from slideframe.products import Filling


def geostatic_strain(filling: Filling, problem: SimulationProblem) -> Float64Array:
    """Return the elastic Hencky strain (n, 3, 3) under the weight of the soil above, and K0 times that across.

    The depth of a particle is that below the highest one of its column, whose width is a particle's.
    """
    material, simulation = problem.material, problem.simulation
    gravity = np.array(simulation.gravity)
    strength = float(np.linalg.norm(gravity))
    if strength == 0:
        return np.zeros((len(filling.particle_positions), 3, 3))
    up = -gravity / strength
    pressure = material.density * strength * depths(filling, up)
    at_rest = material.earth_pressure_at_rest if simulation.earth_pressure is None else simulation.earth_pressure
    along = np.outer(up, up)
    stress = -pressure[:, None, None] * (along + at_rest * (np.eye(3) - along))
    trace = np.trace(stress, axis1=1, axis2=2) / (3 * material.bulk_modulus)
    strain: Float64Array = (stress - material.lame_lambda * trace[:, None, None] * np.eye(3)) / (
        2 * material.shear_modulus
    )
    return strain


def depths(filling: Filling, up: Float64Array) -> Float64Array:
    """Return how deep each particle (n,) lies below the surface against the unit vector `up`, m."""
    positions = filling.particle_positions.astype(np.float64)
    width = float(np.median(filling.particle_volumes)) ** (1 / 3)
    across, _ = np.linalg.qr(np.column_stack([up, np.eye(3)[np.argsort(np.abs(up))[:2]].T]))
    plan = positions @ across[:, 1:]
    # half a width aside, so that a lattice's particles stand in the middle of their columns
    column = np.round((plan - plan.min(axis=0)) / width).astype(np.int64)
    _, which = np.unique(column, axis=0, return_inverse=True)
    heights = positions @ up
    tops = np.full(int(which.max()) + 1, -np.inf)
    np.maximum.at(tops, which.ravel(), heights)
    below: Float64Array = tops[which.ravel()] + width / 2 - heights
    return below


def elastic_state(hencky: Float64Array) -> Float64Array:
    """Return X = exp(2 h) - 1 of Hencky strains (n, 3, 3) as (xx, yy, zz, yz, xz, xy) (n, 6)."""
    values, vectors = np.linalg.eigh(hencky)
    state = (vectors * np.expm1(2 * values)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return np.stack([state[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=1)
