"""The ladder's figures for two motions of one problem: where the mass went, and how its energy went with time."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.motion import FrameFigures, measure
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame

# docs/physics.md: long runs of two backends; to the float64 reference twice that
TOLERANCE = 0.01
# edge of the columns whose thickness is compared, in cells
COLUMN_CELLS = 2


@dataclass(frozen=True)
class Figure:
    """One figure of two motions.

    Attributes:
        name: in words.
        unit: of both values.
        first: of the first motion.
        second: of the second motion.
        difference: relative, see `of`.
        of: what the difference is a share of.
        gated: whether the ladder bounds it; particle by particle it doesn't.
    """

    name: str
    unit: str
    first: float
    second: float
    difference: float
    of: str
    gated: bool = True


@dataclass(frozen=True)
class Comparison:
    """What two motions of one problem have in common.

    Attributes:
        figures: the ladder's figures at the last output time, and the largest differences over time.
        times: output times (frame,), s.
        kinetic: kinetic energies (frame, 2), J.
        potential: potential energies (frame, 2), J, zero at t = 0.
    """

    figures: list[Figure]
    times: Float64Array
    kinetic: Float64Array
    potential: Float64Array

    def agrees(self, tolerance: float = TOLERANCE) -> bool:
        """Whether every gated figure differs by at most `tolerance`."""
        return all(figure.difference <= tolerance for figure in self.figures if figure.gated)


def compare(
    first: Iterable[ParticleFrame], second: Iterable[ParticleFrame], filling: Filling, problem: SimulationProblem
) -> Comparison:
    """Compare two motions that start from the same filling, reading each frame once."""
    measured: list[tuple[FrameFigures, FrameFigures]] = []
    times: list[float] = []
    for pair in zip(first, second, strict=True):
        times.append(pair[0].time)
        mine, theirs = (measure(frame, filling, problem) for frame in pair)
        measured.append((mine, theirs))
    kinetic = np.array([[figures.kinetic_energy_j for figures in each] for each in measured])
    potential = np.array([[figures.potential_energy_j for figures in each] for each in measured])
    figures = [
        *_places(pair, measured[-1], filling, problem),
        _over_time("kinetic energy, at its peak", kinetic, "peak"),
        _over_time("potential energy, at the end", potential, "release"),
        *_pointwise(pair),
    ]
    return Comparison(figures, np.array(times), kinetic, potential)


def _places(
    last: tuple[ParticleFrame, ParticleFrame],
    figures: tuple[FrameFigures, FrameFigures],
    filling: Filling,
    problem: SimulationProblem,
) -> list[Figure]:
    """Centre of mass, run-out and deposit at the end."""
    run_outs = [each.run_out_m for each in figures]
    scale = max(*run_outs, problem.simulation.grid_spacing)
    of = "run-out" if scale in run_outs else "cell"
    centres = [
        np.average(frame.positions.astype(np.float64), axis=0, weights=filling.particle_volumes) for frame in last
    ]
    found = [
        Figure(f"centre of mass, {axis}", "m", float(mine), float(theirs), float(abs(mine - theirs)) / scale, of)
        for axis, mine, theirs in zip("xyz", *centres, strict=True)
    ]
    found.append(Figure("run-out", "m", run_outs[0], run_outs[1], abs(run_outs[0] - run_outs[1]) / scale, of))
    deposits = [thickness(frame, filling, problem.simulation.grid_spacing) for frame in last]
    thickest = [float(deposit.max()) for deposit in deposits]
    off = float(np.abs(deposits[0] - deposits[1]).max()) / max(thickest)
    found.append(Figure("deposit profile, thickest", "m", thickest[0], thickest[1], off, "thickest"))
    return found


def thickness(frame: ParticleFrame, filling: Filling, spacing: float) -> Float64Array:
    """Return the thickness (column, row), m, of the mass on a raster of points two cells apart.

    Each particle's volume is shared bilinearly among the four nearest points, so that no single particle's step
    across a border shows.
    """
    edge = COLUMN_CELLS * spacing
    corner, far = filling.bounds[0, :2], filling.bounds[1, :2]
    shape = np.ceil((far - corner) / edge).astype(int) + 2
    places = np.clip((frame.positions[:, :2].astype(np.float64) - corner) / edge, 0, shape - 1.001)
    cells = places.astype(int)
    share = places - cells
    raster = np.zeros(tuple(shape))
    volumes = filling.particle_volumes.astype(np.float64) / edge**2
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1])
            np.add.at(raster, (cells[:, 0] + i, cells[:, 1] + j), weight * volumes)
    return raster


def _over_time(name: str, energies: Float64Array, of: str) -> Figure:
    """The largest difference at any output time, as a share of the largest magnitude."""
    largest = float(np.abs(energies).max())
    instant = int(np.argmax(np.abs(energies).max(axis=1)))
    difference = float(np.abs(energies[:, 0] - energies[:, 1]).max()) / largest if largest else 0.0
    return Figure(name, "J", float(energies[instant, 0]), float(energies[instant, 1]), difference, of)


def _pointwise(last: tuple[ParticleFrame, ParticleFrame]) -> list[Figure]:
    """Particle by particle at the end: after thousands of substeps a statement about chaos, not about a solver."""
    found = []
    for name, unit, field in (("place", "m", "positions"), ("speed", "m/s", "velocities")):
        mine, theirs = (getattr(frame, field).astype(np.float64) for frame in last)
        apart = np.linalg.norm(mine - theirs, axis=1)
        worst = int(np.argmax(apart))
        first, second = (float(np.linalg.norm(values[worst])) for values in (mine, theirs))
        found.append(
            Figure(f"one particle's {name}, {worst}", unit, first, second, float(apart[worst]), unit, gated=False)
        )
    return found
