"""How fast the solvers move a block of sand on the CPU, after showing that they move it alike.

    python benchmarks/mpm.py [--particles N] [--reference-particles N] [--frames N] [--growth N ...]

A cube of sand, eight particles per cell, slumps from the corner of a channel with a rough floor. A small cube shows
first how far each solver is from the float64 reference; the large one then measures the solvers beside a plain MPM in
the same language (benchmarks/plain). Each solver has a process of its own, which shows its peak memory. They take turns
frame by frame, so that a busy moment harms all alike, and the first frame, which compiles, is left out. A frame's time
is what a caller waits for: substeps, sorting, checks and the copy that is handed out. `--growth` measures more cubes.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from machine import print_machine

from slideframe import registry
from slideframe.device import Device
from slideframe.problem import SimulationProblem, Wall
from slideframe.products import Filling
from slideframe.reference.solver import ReferenceSolver
from slideframe.stages import Context
from slideframe.testing.solver_scenes import block_filling, sand_problem

SPACING = 0.25  # of the grid, m
YOUNGS_MODULUS = 2e7  # keeps the strain under the own weight of some metres below a percent
FRAME_RATE = 40.0  # some thirty substeps a frame, as in a film
# Of the largest value in the reference: float32 leaves 2e-4 of this short slump; longer ones magnify it.
TOLERANCE = 0.01
PLAIN = {"mpm_warp": "plain warp", "mpm_taichi": "plain taichi"}


def cube_of_sand(particles: int, frames: int) -> tuple[Filling, SimulationProblem]:
    """Return the cube of whole cells whose number of particles is nearest to that asked for.

    The particles come in no order, as in the plain solvers' own examples, and as a scan's splats would give them.
    """
    edge = SPACING * max(2, round((particles / 8) ** (1 / 3)))
    filling = block_filling((0, 0, 0), (edge, edge, edge), size=(2 * edge, edge), particle_spacing=SPACING / 2)
    order = np.random.default_rng(0).permutation(len(filling.particle_positions))
    filling = filling.model_copy(update={"particle_positions": filling.particle_positions[order]})
    problem = sand_problem(
        spacing=SPACING,
        duration=frames / FRAME_RATE,
        frame_rate=FRAME_RATE,
        youngs_modulus=YOUNGS_MODULUS,
        floor=Wall(kind="friction", friction_angle=22.0),
    )
    return filling, problem


def frames_of(name: str, filling: Filling, problem: SimulationProblem) -> Iterator[np.ndarray]:
    """Give the positions (n, 3), m, after each frame."""
    if name in PLAIN.values():
        plain, substeps = plain_solver(name, filling, problem), problem.time_step(problem.grid(filling))[1]
        while True:
            plain.step(substeps)
            yield plain.positions()
    solver = ReferenceSolver() if name == "reference" else registry.load([name])[name]()
    with tempfile.TemporaryDirectory() as scratch:
        frames = solver.solve(filling, problem, Context(Device(), Path(scratch)))
        next(frames)
        for frame in frames:
            yield frame.positions


def plain_solver(name: str, filling: Filling, problem: SimulationProblem):
    if name == "plain taichi":
        import taichi as ti

        ti.init(arch=ti.cpu, log_level=ti.ERROR)
        from plain.taichi_kernels import Plain
    else:
        from plain.warp_kernels import Plain
    return Plain(filling, problem, problem.grid(filling), problem.material.constants.cone_slope)


def work(name: str, particles: int, frames: int, answer: int) -> None:
    """Be the process of one solver: a line asks for a frame, the answer tells its wall and CPU seconds."""
    filling, problem = cube_of_sand(particles, frames)
    motion = frames_of(name, filling, problem)
    with os.fdopen(answer, "w") as answers:
        for line in sys.stdin:
            wall, cpu = time.perf_counter(), time.process_time()
            positions = next(motion)
            told = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
            if line.strip():
                np.save(line.strip(), positions)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            answers.write(json.dumps(told | {"peak_mib": peak}) + "\n")
            answers.flush()


@dataclass
class Racer:
    """A solver in its own process, and the seconds of every frame but the first, which compiles."""

    name: str
    particles: int
    frames: int
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    peak_mib: float = 0.0

    def __post_init__(self) -> None:
        here, there = os.pipe()
        options = ["--worker", self.name, "--answer", str(there), "--particles", str(self.particles)]
        command = [sys.executable, __file__, *options, "--frames", str(self.frames)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=[there], text=True, **quiet)
        os.close(there)
        self._answers = os.fdopen(here)

    def advance(self, save: str = "") -> None:
        self._process.stdin.write(save + "\n")
        self._process.stdin.flush()
        line = self._answers.readline()
        if not line:
            raise SystemExit(f"{self.name} stopped with exit code {self._process.wait()}")
        told = json.loads(line)
        self.wall.append(told["wall"])
        self.cpu.append(told["cpu"])
        self.peak_mib = told["peak_mib"]

    def finish(self) -> "Racer":
        self._process.stdin.close()
        self._process.wait()
        del self.wall[0], self.cpu[0]
        return self


def race(names: list[str], particles: int, frames: int) -> list[Racer]:
    """Let the solvers take turns."""
    racers = [Racer(name, particles, frames) for name in names]
    for _ in range(frames):
        for racer in racers:
            racer.advance()
    return [racer.finish() for racer in racers]


def print_agreement(particles: int, frames: int) -> bool:
    """Print each solver's largest deviation from the reference, and return whether all are small."""
    filling, problem = cube_of_sand(particles, frames)
    count, substeps = len(filling.particle_positions), problem.time_step(problem.grid(filling))[1]
    print(f"\nsmall cube: {count:,} particles, {frames} frames of {substeps} substeps; against the float64 reference")
    print(f"{'relative to the reference':<28}{'centre of mass':>16}{'displacement':>14}")
    moved, worst = {}, 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name in ("reference", *PLAIN, *PLAIN.values()):
            racer = Racer(name, particles, frames)
            for _ in range(frames):
                racer.advance(f"{folder}/positions.npy")
            racer.finish()
            moved[name] = np.load(f"{folder}/positions.npy").astype(np.float64) - filling.particle_positions
    for name, mine in moved.items():
        pairs = ((mine.mean(axis=0), moved["reference"].mean(axis=0)), (mine, moved["reference"]))
        errors = [float(np.abs(one - other).max() / np.abs(other).max()) for one, other in pairs]
        print(f"{name:<28}{errors[0]:>16.1e}{errors[1]:>14.1e}")
        worst = max(worst, *errors)
    return worst <= TOLERANCE


def print_speeds(racers: list[Racer]) -> None:
    """Print speeds of the median frame, the ratio to the plain MPM in the same language, and memory."""
    filling, problem = cube_of_sand(racers[0].particles, 1)
    count, substeps = len(filling.particle_positions), problem.time_step(problem.grid(filling))[1]
    speeds = {
        racer.name: [1e-6 * count * substeps / statistics.median(seconds) for seconds in (racer.wall, racer.cpu)]
        for racer in racers
    }
    print(f"\ncube of {count:,} particles, {len(racers[0].wall)} frames of {substeps} substeps")
    print(f"{'million particle-substeps':<20}{'per s':>8}{'per CPU-s':>11}{'to plain':>10}{'CPU':>7}", end="")
    print(f"{'bytes/particle':>16}{'peak MiB':>10}")
    for racer in racers:
        wall, cpu = speeds[racer.name]
        ratios = f"{'':>17}{'':>16}"
        if PLAIN.get(racer.name) in speeds:
            plain = speeds[PLAIN[racer.name]]
            ratios = f"{wall / plain[0]:>10.1f}{cpu / plain[1]:>7.1f}"
        if racer.name in PLAIN:
            ratios = f"{ratios:>17}{bytes_per_particle(racer.name, filling, problem):>16.0f}"
        print(f"{racer.name:<20}{wall:>8.2f}{cpu:>11.2f}{ratios}{racer.peak_mib:>10.0f}")


def bytes_per_particle(name: str, filling: Filling, problem: SimulationProblem) -> float:
    """Return what the solver estimates before it allocates anything, grid included."""
    from slideframe.tiles import estimate_nodes

    count = len(filling.particle_positions)
    nodes = estimate_nodes(filling, problem.grid(filling))
    return registry.load([name])[name]().bytes_needed(count, nodes, problem.simulation) / count


def print_shares(name: str, particles: int) -> None:
    """Print each kernel's share of the CPU time of sixty substeps, sorting included."""
    from shares import measure

    seconds = measure(name, *cube_of_sand(particles, 8))
    total = sum(seconds.values())
    shares = ", ".join(f"{kernel} {100 * part / total:.0f} %" for kernel, part in seconds.items())
    print(f"{name:<12} {shares}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--reference-particles", type=int, default=4_000)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--growth", type=int, nargs="*", default=[300_000, 1_000_000, 3_000_000])
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--answer", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options.worker, options.particles, options.frames, options.answer)
        return
    print_machine("slideframe", "numpy", "warp-lang", "taichi")
    if not print_agreement(options.reference_particles, options.frames):
        raise SystemExit(f"a solver is further from the reference than {TOLERANCE:g}: its speed means nothing")
    print_speeds(race([*PLAIN, *PLAIN.values()], options.particles, options.frames))
    print("\nshare of each kernel in CPU time")
    for name in PLAIN:
        command = [sys.executable, "-c", SHARES.format(name=name, particles=options.particles)]
        subprocess.run(command, cwd=Path(__file__).parent, check=True)
    for particles in options.growth:
        print_speeds(race(list(PLAIN), particles, 3))


# in a process of its own, since Taichi and Warp would share one
SHARES = "import mpm; mpm.print_shares({name!r}, {particles})"


if __name__ == "__main__":
    main()
