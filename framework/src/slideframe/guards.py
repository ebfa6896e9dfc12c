"""What every explicit solver asks before it starts and while it runs: is the start sound, does it fit, is it alive."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError, InputError, StageFailed
from slideframe.problem import Grid, Simulation, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import LEAST_BYTES_PER_PARTICLE, Context
from slideframe.stress import stress_fields

# Particles may start this share of a cell outside the walls: the rounding of a float32 coordinate, not a mistake.
START_TOLERANCE = 0.01

LeastMemory = Callable[[float, Simulation], float]

# A solver that hands out no frame for so long tells how far it is within it, s.
QUIET_SECONDS = 2.0

# The renderer can use stretches between these bounds: beyond them a splat becomes a needle (docs/physics.md).
STRETCH_BOUNDS = (0.5, 2.0)


def _least(particle_count: float, simulation: Simulation) -> float:
    return particle_count * LEAST_BYTES_PER_PARTICLE


def check_spacing(plan_size: tuple[float, float], simulation: Simulation, least_memory: LeastMemory = _least) -> None:
    """Refuse a grid with less than two cells across the region's plan, or with more than memory can surely hold.

    Raises:
        ConfigurationError: the cells are too large or too small.
    """
    spacing, narrowest = simulation.grid_spacing, min(plan_size)
    if spacing > narrowest / 2:
        raise ConfigurationError(
            f"grid_spacing {spacing:g} m leaves less than two cells across the region's {narrowest:g} m",
            where="simulation.grid_spacing",
            cure=f"use at most {narrowest / 2:g} m; six or more cells across the moving mass give useful results",
        )
    # before the surface is known, at least one layer of cells is certain
    particles = plan_size[0] * plan_size[1] / spacing**2 * simulation.particles_per_cell
    what = f"one layer of cells of {spacing:g} m alone holds {particles:,.0f} particles"
    _require_room(least_memory(particles, simulation), what)


def check_volume(volume: float, simulation: Simulation, least_memory: LeastMemory) -> None:
    """Refuse to move a volume, m3, that so fine a grid can't hold in memory.

    Raises:
        ConfigurationError: the particles are too many.
    """
    particles = volume / simulation.particle_spacing**3
    what = (
        f"the mass of at least {volume:,.0f} m3 is {particles:,.0f} particles in cells of {simulation.grid_spacing:g} m"
    )
    _require_room(least_memory(particles, simulation), what)


def check_particles(volume: float, spacing: float) -> None:
    """Refuse to fill a volume, m3, with more particles, `spacing` m apart, than memory can surely hold.

    Raises:
        ConfigurationError: the particles are too many.
    """
    particles = volume / spacing**3
    what = f"the mass of {volume:,.0f} m3 would be {particles:,.0f} particles {spacing:g} m apart"
    _require_room(particles * LEAST_BYTES_PER_PARTICLE, what)


def _require_room(needed: float, what: str) -> None:
    free = available_memory()
    if needed > free:
        raise ConfigurationError(
            f"{what}, which need at least {needed / 1e9:.1f} GB: more than the {free / 1e9:.1f} GB of free memory",
            where="simulation.grid_spacing",
            cure="raise grid_spacing (doubling it takes an eighth of the memory) or make the region smaller",
        )


def check_start(filling: Filling, problem: SimulationProblem) -> Grid:
    """Return the grid for particles that lie within the region's walls.

    Raises:
        ConfigurationError: the cells are too large for the region.
        InputError: there are no particles, they lie outside the walls, a volume isn't positive, or a position or a
            velocity isn't finite.
    """
    positions = filling.particle_positions
    if not len(positions):
        raise InputError(
            "the filling holds no particles",
            where="solver",
            cure="place the region where the scan shows ground, and its z_min below it",
        )
    _check_finite(filling)
    width, depth, _ = np.ptp(filling.bounds, axis=0)
    check_spacing((float(width), float(depth)), problem.simulation)
    _check_inside(filling, problem)
    if not (filling.particle_volumes > 0).all():
        index = int(np.argmin(filling.particle_volumes))
        raise InputError(
            f"particle {index} has the volume {filling.particle_volumes[index]:g} m3",
            where="filling.particle_volumes",
            cure="volumes must be positive",
        )
    return problem.grid(filling)


def _check_finite(filling: Filling) -> None:
    arrays = {"particle_positions": filling.particle_positions, "particle_velocities": filling.start_velocities()}
    for name, values in arrays.items():
        bad = ~np.isfinite(values).all(axis=1)
        if bad.any():
            index = int(np.argmax(bad))
            raise InputError(
                f"{int(bad.sum())} of {len(bad)} particles have {name} that aren't finite, "
                f"the first is particle {index} with {values[index].tolist()}",
                where=f"filling.{name}",
                cure="look at what made the filling: every particle needs a place and a velocity, m and m/s",
            )


def _check_inside(filling: Filling, problem: SimulationProblem) -> None:
    positions = filling.particle_positions
    slack = START_TOLERANCE * problem.simulation.grid_spacing
    low, high = problem.boundary.domain.bounds(filling)
    low, high = low - slack, high + slack
    outside = ((positions < low) | (positions > high)).any(axis=1)
    if outside.any():
        index = int(np.argmax(outside))
        raise InputError(
            f"{int(outside.sum())} of {len(positions)} particles lie outside the domain's walls, "
            f"the first is particle {index} at {_place(positions[index])}",
            where="solver",
            cure="fill and simulate the same region, and let boundary.domain hold the whole mass",
        )


def start_frame(filling: Filling, problem: SimulationProblem) -> ParticleFrame:
    """Return the frame at t = 0: the filling's own positions and velocities, without stress."""
    count = len(filling.particle_positions)
    return ParticleFrame(
        time=0.0,
        positions=filling.particle_positions.copy(),
        velocities=filling.start_velocities().copy(),
        deformation_gradients=np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
        **stress_fields(np.zeros((count, 3, 3)), np.zeros(count), problem),
    )


def check_memory(bytes_needed: float, particle_count: int, node_count: int) -> None:
    """Refuse what main memory can't hold, before anything is allocated.

    Raises:
        ConfigurationError: the estimate exceeds the memory that is free.
    """
    free = available_memory()
    if bytes_needed > free:
        raise ConfigurationError(
            f"the simulation needs about {bytes_needed / 1e9:.1f} GB for {particle_count:,} particles and "
            f"{node_count:,} grid nodes, but {free / 1e9:.1f} GB are free",
            where="simulation.grid_spacing",
            cure="raise grid_spacing (doubling it takes an eighth of the memory) or make the region smaller",
        )


def available_memory() -> int:
    """Return the bytes that new allocations may take: Linux's own estimate, else all physical memory."""
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass  # not Linux: the answer below is the best that POSIX offers
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def check_motion(
    positions: npt.NDArray[np.floating],
    velocities: npt.NDArray[np.floating],
    moment: float,
    grid: Grid,
    time_step: float,
) -> None:
    """Stop a simulation that has lost its meaning.

    Args:
        positions: (n, 3), m.
        velocities: (n, 3), m/s.
        moment: simulated time, s.
        grid: the background grid.
        time_step: s.

    Raises:
        StageFailed: a velocity isn't finite, or crosses more than a cell in one substep.
    """
    limit = grid.spacing / time_step
    speeds = np.sqrt(np.einsum("pi,pi->p", velocities, velocities))
    # written so that NaN, too, is found
    bad = ~(speeds <= limit)
    if bad.any():
        # the fastest; argmax takes NaN for the largest
        index = int(np.argmax(speeds))
        raise StageFailed(
            f"the simulation blew up: particle {index} at {_place(positions[index])} "
            f"has the speed {speeds[index]:g} m/s, "
            f"{int(bad.sum())} of {len(bad)} particles exceed one cell per substep ({limit:g} m/s)",
            where=f"solver, at t = {moment:.6g} s of simulated time",
            cure="lower simulation.cfl; if that doesn't help, look for particles that start on top of one another, "
            "or use simulation.precision = 'float64'. Frames before this time are kept",
        )


def _place(position: npt.NDArray[np.floating]) -> str:
    return "({:.3f}, {:.3f}, {:.3f}) m".format(*position)


@dataclass
class Pace:
    """Measures a solver's speed and reports the figures that all solvers share.

    Attributes:
        masses: (n,), kg.
        time_step: s.
        substeps: all so far, those of an earlier run that broke off included.
    """

    context: Context
    simulation: Simulation
    masses: Float64Array
    time_step: float
    substeps: int = field(default=0, init=False)
    _earlier: int = field(default=0, init=False)
    _frames: int = field(default=0, init=False)
    _seconds: float = field(default=0.0, init=False)
    _started: float = field(default=0.0, init=False)
    _told: float = field(default=0.0, init=False)
    _untold: int = field(default=0, init=False)
    _compiled: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._told = time.perf_counter()
        self.context.figure("particles", len(self.masses))
        self.context.figure("mass_kg", float(self.masses.sum()))
        self.context.figure("time_step_s", self.time_step)

    def __enter__(self) -> None:
        self._started = self._told = time.perf_counter()
        self._untold = 0

    def __exit__(self, *failure: object) -> None:
        self._seconds += time.perf_counter() - self._started

    def resume(self, substeps: int) -> None:
        """Count what an earlier run did, but not into this run's speed."""
        self.substeps = self._earlier = substeps

    def kinetic_energy(self, product: ParticleFrame) -> float:
        """Return the energy of the particles' own velocities, J.

        Not by BLAS, whose threads spin for a while after each product and take a core from the solver's own.
        """
        squared_speed = np.einsum("pi,pi->p", product.velocities, product.velocities, dtype=np.float64)
        return float(0.5 * np.einsum("p,p", self.masses, squared_speed))

    def substep_done(self, elapsed: float, time_step: float, speed: float) -> None:
        """Report progress within a frame that takes long; `elapsed` is simulated time, negative before t = 0."""
        if not self._compiled:  # the first substep's time says nothing of the next ones'
            self._compiled, self._told, self._untold = True, time.perf_counter(), 0
            return
        self._untold += 1
        seconds = time.perf_counter() - self._told
        if seconds < QUIET_SECONDS:
            return
        frames, rate = self.simulation.frame_count - 1, self._untold / seconds
        self.context.progress(
            max(elapsed, 0.0) * self.simulation.frame_rate,
            frames,
            simulated_s=elapsed,
            substeps_per_second=rate,
            time_step_s=time_step,
            remaining_s=(frames / self.simulation.frame_rate - elapsed) / time_step / rate,
            fastest_m_per_s=speed,
        )
        self._told, self._untold = time.perf_counter(), 0

    def frame_done(
        self, frame: int, substeps: int, product: ParticleFrame, energy: float, *, last: bool = False
    ) -> None:
        """Report progress and figures after output frame `frame`, of which 0 is the start; `last`: it ends early."""
        self.substeps += substeps
        self._frames += 1
        rate = (self.substeps - self._earlier) / self._seconds if self._seconds else 0.0
        self.context.figure("substeps", self.substeps)
        self.context.figure("substeps_per_second", rate)
        self.context.figure("particle_substeps_per_second", rate * len(self.masses))
        self.context.figure("escaped_particles", product.escaped)
        frames = self.simulation.frame_count - 1
        self.context.progress(
            frames if last else frame,
            frames,
            simulated_s=product.time,
            substeps_per_second=rate,
            remaining_s=0.0 if last else self._seconds / self._frames * (frames - frame),
            kinetic_energy_j=energy,
        )
