"""The stage `mpm_taichi`."""

from collections.abc import Iterator
from typing import ClassVar

from slideframe.checkpoint import Checkpoints
from slideframe.explicit_solver import ExplicitSolver
from slideframe.problem import Simulation, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context
from slideframe.time_integration import March


class TaichiSolver(ExplicitSolver):
    """Explicit MLS-MPM on the CPU's cores or an NVIDIA card by Taichi."""

    name = "mpm_taichi"
    backend: ClassVar[tuple[str, ...]] = ("taichi",)

    def bytes_needed(self, particle_count: int, node_count: int, simulation: Simulation) -> int:
        """Return the memory that a simulation takes."""
        from slideframe_mpm_taichi.stepper import bytes_needed

        return bytes_needed(particle_count, node_count, simulation)

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; on the CPU the same input gives the same bits, whatever the number of threads."""
        from slideframe_mpm_taichi.runtime import session
        from slideframe_mpm_taichi.stepper import Stepper

        grid = self.sound_grid(filling, problem)
        with session(context.device, problem.simulation.precision):
            stepper = Stepper(filling, problem, grid, context.device)
            yield from March(filling, problem, grid, context).frames(
                stepper, Checkpoints(context, self.checkpoint_every)
            )
