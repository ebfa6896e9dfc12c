"""The stage `mpm_warp`."""

from collections.abc import Iterator
from typing import ClassVar

from slideframe.checkpoint import Checkpoints
from slideframe.explicit_solver import ExplicitSolver
from slideframe.problem import Simulation, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context
from slideframe.time_integration import March


class WarpSolver(ExplicitSolver):
    """Explicit MLS-MPM on the CPU or an NVIDIA card by NVIDIA Warp."""

    name = "mpm_warp"
    backend: ClassVar[tuple[str, ...]] = ("warp",)

    def bytes_needed(self, particle_count: int, node_count: int, simulation: Simulation) -> int:
        """Return the memory that a simulation takes."""
        from slideframe_mpm_warp.stepper import bytes_needed

        return bytes_needed(particle_count, node_count, simulation)

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; on the CPU the same input gives the same bits."""
        from slideframe_mpm_warp.stepper import Stepper

        grid = self.sound_grid(filling, problem)
        stepper = Stepper(filling, problem, grid, str(context.device))
        yield from March(filling, problem, grid, context).frames(stepper, Checkpoints(context, self.checkpoint_every))
