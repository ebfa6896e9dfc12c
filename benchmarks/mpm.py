"""How fast the solvers move a block of sand on the CPU, after showing that they move it alike.

    python benchmarks/mpm.py [--particles N] [--reference-particles N] [--frames N]

A cube of sand, eight particles per cell, slumps from the corner of a channel with a rough floor. A small cube shows
first how far each solver is from the float64 reference and how fast the reference is; the large one then measures the
solvers. They take turns frame by frame, so that a busy moment harms all alike, and the first frame, which compiles, is
left out. A frame's time is what a caller waits for: substeps, checks and the copy that is handed out.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from machine import print_machine

from slideframe import registry
from slideframe.device import Device
from slideframe.problem import SimulationProblem, Wall
from slideframe.products import Filling, ParticleFrame
from slideframe.reference.solver import ReferenceSolver
from slideframe.stages import Context, Solver
from slideframe.testing.solver_scenes import block_filling, sand_problem

SPACING = 0.25  # of the grid, m
YOUNGS_MODULUS = 2e7  # keeps the strain under the own weight of some metres below a percent
FRAME_RATE = 40.0  # some twenty substeps a frame, as in a film
# Of the largest value in the reference: float32 leaves 2e-4 of this short slump; longer ones magnify it.
TOLERANCE = 0.01


def cube_of_sand(particles: int, frames: int) -> tuple[Filling, SimulationProblem]:
    """Return the cube of whole cells whose number of particles is nearest to that asked for."""
    edge = SPACING * max(2, round((particles / 8) ** (1 / 3)))
    filling = block_filling((0, 0, 0), (edge, edge, edge), size=(2 * edge, edge), particle_spacing=SPACING / 2)
    problem = sand_problem(
        spacing=SPACING,
        duration=frames / FRAME_RATE,
        frame_rate=FRAME_RATE,
        youngs_modulus=YOUNGS_MODULUS,
        floor=Wall(kind="friction", friction_angle=22.0),
    )
    return filling, problem


@dataclass
class Lap:
    """What one solver did: its newest frame, and the wall and CPU seconds of every frame but the first."""

    motion: Iterator[ParticleFrame]
    frame: ParticleFrame
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def advance(self) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        self.frame = next(self.motion)
        self.wall.append(time.perf_counter() - wall)
        self.cpu.append(time.process_time() - cpu)


def race(solvers: Mapping[str, Solver], filling: Filling, problem: SimulationProblem) -> dict[str, Lap]:
    with tempfile.TemporaryDirectory() as scratch:
        motions = {
            name: solver.solve(filling, problem, Context(Device(), Path(scratch))) for name, solver in solvers.items()
        }
        laps = {name: Lap(motion, next(motion)) for name, motion in motions.items()}
        for _ in range(problem.simulation.frame_count - 1):
            for lap in laps.values():
                lap.advance()
    for lap in laps.values():
        del lap.wall[0], lap.cpu[0]  # these compiled
    return laps


def particle_substeps(filling: Filling, problem: SimulationProblem) -> int:
    """Return how many a frame takes."""
    return len(filling.particle_positions) * problem.time_step(problem.grid(filling))[1]


def describe(filling: Filling, problem: SimulationProblem) -> str:
    count, frames = len(filling.particle_positions), problem.simulation.frame_count - 1
    return f"{count:,} particles, {frames} frames of {particle_substeps(filling, problem) // count} substeps"


def print_agreement(laps: Mapping[str, Lap], start: Filling) -> bool:
    """Print each solver's largest deviation from the reference, and return whether all are small."""
    print(f"{'relative to the reference':<28}{'centre of mass':>16}{'displacement':>14}{'velocity':>10}{'F - 1':>10}")
    expected = fields(laps["reference"].frame, start)
    worst = 0.0
    for name in [name for name in laps if name != "reference"]:
        pairs = zip(fields(laps[name].frame, start), expected, strict=True)
        errors = [float(np.abs(mine - theirs).max() / np.abs(theirs).max()) for mine, theirs in pairs]
        print(f"{name:<28}{errors[0]:>16.1e}{errors[1]:>14.1e}{errors[2]:>10.1e}{errors[3]:>10.1e}")
        worst = max(worst, *errors)
    return worst <= TOLERANCE


def fields(frame: ParticleFrame, start: Filling) -> list[np.ndarray]:
    displacements = frame.positions.astype(np.float64) - start.particle_positions
    return [displacements.mean(axis=0), displacements, frame.velocities, frame.deformation_gradients - np.eye(3)]


def speeds(lap: Lap, per_frame: int) -> tuple[float, float]:
    """Return millions of particle-substeps per second of wall and of CPU time, in the median frame."""
    return 1e-6 * per_frame / statistics.median(lap.wall), 1e-6 * per_frame / statistics.median(lap.cpu)


def print_speeds(laps: Mapping[str, Lap], per_frame: int, reference: tuple[float, float]) -> None:
    print(
        f"{'million particle-substeps':<28}{'per second':>16}{'per CPU-second':>16}{'to the reference':>18}{'CPU':>8}"
    )
    for name, lap in laps.items():
        wall, cpu = speeds(lap, per_frame)
        print(f"{name:<28}{wall:>16.3f}{cpu:>16.3f}{wall / reference[0]:>18.1f}{cpu / reference[1]:>8.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--reference-particles", type=int, default=4_000)
    parser.add_argument("--frames", type=int, default=8)
    options = parser.parse_args()
    print_machine("slideframe", "numpy", "warp-lang", "taichi")
    solvers: dict[str, Solver] = {name: stage() for name, stage in registry.load(["mpm_warp", "mpm_taichi"]).items()}

    filling, problem = cube_of_sand(options.reference_particles, options.frames)
    print(f"\nsmall cube: {describe(filling, problem)}; float32 against the reference's float64")
    laps = race({"reference": ReferenceSolver(), **solvers}, filling, problem)
    agree = print_agreement(laps, filling)
    reference = speeds(laps["reference"], particle_substeps(filling, problem))
    print_speeds(laps, particle_substeps(filling, problem), reference)
    if not agree:
        raise SystemExit(f"a solver is further from the reference than {TOLERANCE:g}: its speed means nothing")

    filling, problem = cube_of_sand(options.particles, options.frames)
    print(f"\nlarge cube: {describe(filling, problem)}; the reference's speed is the small cube's")
    print_speeds(race(solvers, filling, problem), particle_substeps(filling, problem), reference)


if __name__ == "__main__":
    main()
