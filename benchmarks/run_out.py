"""What a run-out of a kilometre on cells of 0.25 m takes of memory.

    python benchmarks/run_out.py [--solver mpm_warp | mpm_taichi] [--particles N] [--sliding N]

The box is 1000 m long, 500 m wide and 200 m high: thousands of millions of nodes, far over 100 GB. First a small block
slides the kilometre on a floor without friction, and the nodes it needs are counted on its way. Then a deposit of
millions of particles lies along the whole kilometre, and is stepped: what a process that does all this takes at its
peak must be below 8 GB.
"""

import argparse
import resource
from contextlib import nullcontext

import numpy as np
from machine import print_machine

from slideframe.device import Device
from slideframe.problem import SimulationProblem
from slideframe.products import Filling
from slideframe.testing.solver_scenes import filling_of, sand_problem
from slideframe.tiles import estimate_nodes
from slideframe.time_integration import Step

SPACING = 0.25
PARTICLE_SPACING = SPACING / 2
BOX = np.array([[0.0, 0.0, 0.0], [1000.0, 500.0, 200.0]])
LIMIT_GB = 8.0


def lattice(low, counts) -> np.ndarray:
    steps = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    return (np.array(low) + PARTICLE_SPACING * (steps + 0.5)).astype(np.float32)


def mass(positions: np.ndarray, speed: float = 0.0) -> Filling:
    filling = filling_of(positions, PARTICLE_SPACING**3)
    velocities = np.zeros_like(positions)
    velocities[:, 0] = speed
    return filling.model_copy(update={"bounds": BOX, "particle_velocities": velocities})


def deposit(particles: int) -> Filling:
    """Return a sheet of 0.5 m that meanders along the kilometre."""
    length, height = round(990.0 / PARTICLE_SPACING), 4
    sheet = lattice((2.0, 240.0, 0.0), (length, max(1, particles // (length * height)), height))
    sheet[:, 1] += (30.0 * np.sin(sheet[:, 0] / 80.0)).astype(np.float32)
    return mass(sheet)


def soft(**more) -> SimulationProblem:
    """Return sand so soft that few substeps carry it far."""
    return sand_problem(spacing=SPACING, youngs_modulus=1e5, **more)


def stepper_of(name: str, filling: Filling, problem: SimulationProblem):
    grid = problem.grid(filling)
    if name == "mpm_warp":
        from slideframe_mpm_warp.stepper import Stepper

        stepper = Stepper(filling, problem, grid, "cpu")
    else:
        from slideframe_mpm_taichi.stepper import Stepper

        stepper = Stepper(filling, problem, grid, Device())
    stepper.begin(Step(problem.time_step(grid)[0], problem.simulation.gravity))
    return stepper


def session_of(name: str):
    if name == "mpm_warp":
        return nullcontext()
    from slideframe_mpm_taichi.runtime import session

    return session(Device(), "float32")


def peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def lie(name: str, particles: int) -> None:
    filling, problem = deposit(particles), soft()
    grid = problem.grid(filling)
    stepper = stepper_of(name, filling, problem)
    for _ in range(20):
        stepper.substep()
    count, nodes = len(filling.particle_positions), stepper.layout.node_count
    print(f"a deposit of {count * PARTICLE_SPACING**3:,.0f} m3 along the kilometre, {count:,} particles")
    print(f"  nodes of the box {grid.node_count:,}, estimated {estimate_nodes(filling, grid):,}, in use {nodes:,}")
    print(f"  peak memory {peak_gb():.2f} GB, below {LIMIT_GB:g} GB: {peak_gb() < LIMIT_GB}")


def slide(name: str, particles: int) -> None:
    edge = max(4, round(particles ** (1 / 3)))
    filling = mass(lattice((2.0, 250.0, 0.0), (edge, edge, edge)), speed=40.0)
    stepper = stepper_of(name, filling, soft(gravity=(2.0, 0.0, -9.81)))
    count = len(filling.particle_positions)
    print(f"a block of {count:,} particles slides:", end="", flush=True)
    before = -np.inf
    for substeps in range(1, 10**6):
        stepper.substep()
        if substeps % 100 == 0:
            front = float(np.percentile(stepper.motion()[0][:, 0], 99))
            if front - before > 100:
                before = front
                print(f" {front:.0f} m: {stepper.layout.node_count:,} nodes;", end="", flush=True)
            if front > 990:
                break
    print(f"\n  {substeps:,} substeps")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--solver", choices=["mpm_warp", "mpm_taichi"], default="mpm_warp")
    parser.add_argument("--particles", type=int, default=2_000_000)
    parser.add_argument("--sliding", type=int, default=4_000)
    options = parser.parse_args()
    print_machine("slideframe", "numpy", "warp-lang", "taichi")
    print(options.solver)
    with session_of(options.solver):
        if options.sliding:
            slide(options.solver, options.sliding)
        lie(options.solver, options.particles)


if __name__ == "__main__":
    main()
