"""What a motion amounts to: energies, run-out and what left its place of each frame, the same for every solver."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame

# the farthest particle alone is an outlier
FRONT_SHARE = 0.99
# slower than this is creep, not flow, m/s
FLOWING_SPEED = 0.05
# width of the columns that tell where soil stood, in edges of a particle's cube: an unmoved one has soil in its own
SOURCE_CELL = 2.0


@dataclass(frozen=True)
class FrameFigures:
    """Integral quantities of one frame.

    Attributes:
        kinetic_energy_j: sum of m v² / 2.
        potential_energy_j: -sum of m g·(x - x₀), zero at t = 0.
        run_out_m: horizontal distance since t = 0 that 99 % of the mass has not passed.
        front_m: way that the leading edge has gone: the growth of the horizontal distance, along the main direction
            of the motion, that 99 % of the mass lies behind.
        moving_mass_kg: mass that moves faster than FLOWING_SPEED.
        volume_outside_m3: soil over ground where none was filled at t = 0, by its volume at t = 0.
        mean_displacement_m: mean distance travelled since t = 0.
        fastest_m_per_s: highest particle speed.
        escaped_particles: particles held at the edge of the grid.
    """

    kinetic_energy_j: float
    potential_energy_j: float
    run_out_m: float
    front_m: float
    moving_mass_kg: float
    volume_outside_m3: float
    mean_displacement_m: float
    fastest_m_per_s: float
    escaped_particles: int


def measure(
    frame: ParticleFrame, filling: Filling, problem: SimulationProblem, direction: Float64Array | None = None
) -> FrameFigures:
    """Measure one frame in float64.

    `direction` (2,) is the main direction of the motion; none: that of the frame, see `main_direction`.
    """
    volumes = filling.particle_volumes.astype(np.float64)
    masses = volumes * problem.material.density
    start = filling.particle_positions.astype(np.float64)
    displacement = frame.positions - start
    squared_speed = np.sum(frame.velocities.astype(np.float64) ** 2, axis=1)
    along = main_direction(frame, filling) if direction is None else direction
    return FrameFigures(
        kinetic_energy_j=float(0.5 * masses @ squared_speed),
        potential_energy_j=float(-masses @ (displacement @ np.asarray(problem.simulation.gravity))),
        run_out_m=_front(np.hypot(displacement[:, 0], displacement[:, 1]), masses),
        front_m=_front(frame.positions[:, :2] @ along, masses) - _front(start[:, :2] @ along, masses),
        moving_mass_kg=float(masses[squared_speed > FLOWING_SPEED**2].sum()),
        volume_outside_m3=float(volumes[_outside_source(frame, filling)].sum()),
        mean_displacement_m=float(np.linalg.norm(displacement, axis=1).mean()),
        fastest_m_per_s=float(np.sqrt(squared_speed.max())),
        escaped_particles=frame.escaped,
    )


def main_direction(frame: ParticleFrame, filling: Filling) -> Float64Array:
    """Return the horizontal unit vector (2,) of the mass's displacement, or east where it has none."""
    masses = filling.particle_volumes.astype(np.float64)
    way = masses @ (frame.positions[:, :2].astype(np.float64) - filling.particle_positions[:, :2])
    length = float(np.hypot(*way))
    return np.asarray(way / length if length > 0 else [1.0, 0.0], np.float64)


def _outside_source(frame: ParticleFrame, filling: Filling) -> npt.NDArray[np.bool_]:
    """Tell of each particle whether its column of ground held no soil at t = 0."""
    start = filling.particle_positions[:, :2].astype(np.float64)
    edge = np.cbrt(float(filling.particle_volumes.max()))
    # particles are the middles of their cubes
    low, cell = start.min(axis=0) - edge / 2, SOURCE_CELL * edge
    then, now = (np.floor((places - low) / cell).astype(np.int64) for places in (start, frame.positions[:, :2]))
    outside: npt.NDArray[np.bool_] = ((now < 0) | (now > then.max(axis=0))).any(axis=1)
    rows = int(then[:, 1].max()) + 1
    filled = np.zeros((int(then[:, 0].max()) + 1) * rows, np.bool_)
    filled[then @ [rows, 1]] = True
    outside[~outside] = ~filled[now[~outside] @ [rows, 1]]
    return outside


def _front(distances: Float64Array, masses: Float64Array) -> float:
    """Return the least distance that FRONT_SHARE of the mass stays within."""
    order = np.argsort(distances)
    reached = np.cumsum(masses[order])
    return float(distances[order][np.searchsorted(reached, FRONT_SHARE * reached[-1])])
