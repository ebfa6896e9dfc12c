"""What a motion amounts to: energies and run-out of each frame, the same for every solver."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame

# the farthest particle alone is an outlier
FRONT_SHARE = 0.99


@dataclass(frozen=True)
class FrameFigures:
    """Integral quantities of one frame.

    Attributes:
        kinetic_energy_j: sum of m v² / 2.
        potential_energy_j: -sum of m g·(x - x₀), zero at t = 0.
        run_out_m: horizontal distance since t = 0 that 99 % of the mass has not passed.
        mean_displacement_m: mean distance travelled since t = 0.
        fastest_m_per_s: highest particle speed.
        escaped_particles: particles held at the edge of the grid.
    """

    kinetic_energy_j: float
    potential_energy_j: float
    run_out_m: float
    mean_displacement_m: float
    fastest_m_per_s: float
    escaped_particles: int


def measure(frame: ParticleFrame, filling: Filling, problem: SimulationProblem) -> FrameFigures:
    """Measure one frame in float64."""
    masses = filling.particle_volumes.astype(np.float64) * problem.material.density
    displacement = frame.positions.astype(np.float64) - filling.particle_positions
    squared_speed = np.sum(frame.velocities.astype(np.float64) ** 2, axis=1)
    return FrameFigures(
        kinetic_energy_j=float(0.5 * masses @ squared_speed),
        potential_energy_j=float(-masses @ (displacement @ np.asarray(problem.simulation.gravity))),
        run_out_m=_front(np.hypot(displacement[:, 0], displacement[:, 1]), masses),
        mean_displacement_m=float(np.linalg.norm(displacement, axis=1).mean()),
        fastest_m_per_s=float(np.sqrt(squared_speed.max())),
        escaped_particles=frame.escaped,
    )


def _front(distances: Float64Array, masses: Float64Array) -> float:
    """Return the least distance that FRONT_SHARE of the mass stays within."""
    order = np.argsort(distances)
    reached = np.cumsum(masses[order])
    return float(distances[order][np.searchsorted(reached, FRONT_SHARE * reached[-1])])
