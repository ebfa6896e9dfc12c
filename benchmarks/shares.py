"""The CPU seconds of each kernel of a solver, measured from outside."""

import time

from slideframe.device import Device
from slideframe.problem import SimulationProblem
from slideframe.products import Filling
from slideframe.time_integration import Step

SUBSTEPS = 60


def measure(name: str, filling: Filling, problem: SimulationProblem) -> dict[str, float]:
    """Return the CPU seconds of each kernel in some substeps; the first ones, which compile, are left out."""
    return (of_warp if name == "mpm_warp" else of_taichi)(filling, problem)


def of_warp(filling: Filling, problem: SimulationProblem) -> dict[str, float]:
    from slideframe_mpm_warp.stepper import Stepper

    stepper = Stepper(filling, problem, problem.grid(filling), "cpu")
    stepper.begin(Step(problem.time_step(problem.grid(filling))[0], problem.simulation.gravity))
    stepper.substep()
    seconds: dict[str, float] = {}
    launch = stepper.cores.run

    def timed(parts):
        start = time.process_time()
        launch(parts)
        add(seconds, parts[0].kernel.key.split("__")[0], start)

    stepper.cores.run = timed
    return run(stepper, seconds, lambda: None)


def of_taichi(filling: Filling, problem: SimulationProblem) -> dict[str, float]:
    from slideframe_mpm_taichi.runtime import session

    with session(Device(), problem.simulation.precision):
        import taichi as ti

        from slideframe_mpm_taichi import kernels
        from slideframe_mpm_taichi.stepper import Stepper

        stepper = Stepper(filling, problem, problem.grid(filling), Device())
        stepper.begin(Step(problem.time_step(problem.grid(filling))[0], problem.simulation.gravity))
        stepper.substep()
        seconds: dict[str, float] = {}
        names = ("clear_grid", "particles_to_grid", "update_grid", "grid_to_particles", "strain_particles", "reorder")
        originals = {name: getattr(kernels, name) for name in names}
        for name, kernel in originals.items():

            def timed(*inputs, name=name, kernel=kernel):
                start = time.process_time()
                result = kernel(*inputs)
                ti.sync()
                add(seconds, name, start)
                return result

            setattr(kernels, name, timed)
        try:
            return run(stepper, seconds, ti.sync)
        finally:
            for name, kernel in originals.items():
                setattr(kernels, name, kernel)


def run(stepper, seconds: dict[str, float], wait) -> dict[str, float]:
    start = time.process_time()
    for _ in range(SUBSTEPS):
        stepper.substep()
    wait()
    rest = time.process_time() - start - sum(seconds.values())
    return seconds | {"the rest": rest}


def add(seconds: dict[str, float], name: str, start: float) -> None:
    seconds[name] = seconds.get(name, 0.0) + time.process_time() - start
