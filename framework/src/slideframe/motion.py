"""What a motion amounts to: energies and run-out of each frame, the same for every solver."""

from dataclasses import dataclass

import numpy as np

from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame

# the front is where 99 % of the mass has stopped short: the farthest particle alone is an outlier
FRONT_PERCENTILE = 99.0


@dataclass(frozen=True)
class FrameFigures:
    """Integral quantities of one frame.

    Attributes:
        kinetic_energy_j: sum of m v² / 2.
        potential_energy_j: -sum of m g·(x - x₀), zero at t = 0.
        run_out_m: 99th percentile of the horizontal distance travelled since t = 0.
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
        run_out_m=float(np.percentile(np.hypot(displacement[:, 0], displacement[:, 1]), FRONT_PERCENTILE)),
        mean_displacement_m=float(np.linalg.norm(displacement, axis=1).mean()),
        fastest_m_per_s=float(np.sqrt(squared_speed.max())),
        escaped_particles=frame.escaped,
    )
