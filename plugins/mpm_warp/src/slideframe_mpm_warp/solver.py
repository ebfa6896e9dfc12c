"""The stage `mpm_warp`."""

from collections.abc import Iterator
from typing import ClassVar

from slideframe.checkpoint import Checkpoints
from slideframe.explicit_solver import ExplicitSolver
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context
from slideframe.time_integration import March


class WarpSolver(ExplicitSolver):
    """Explicit MLS-MPM on the CPU or an NVIDIA card by NVIDIA Warp."""

    name = "mpm_warp"
    backend: ClassVar[tuple[str, ...]] = ("warp",)
    # held, identities, one more while sorting, and sort keys and places with their spare halves
    integers_per_particle: ClassVar[int] = 1 + 1 + 1 + 2 * 2
    # the column of each node
    integers_per_node: ClassVar[int] = 1

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; on the CPU the same input gives the same bits."""
        from slideframe_mpm_warp.stepper import Stepper

        grid = self.sound_grid(filling, problem)
        stepper = Stepper(filling, problem, grid, str(context.device))
        yield from March(filling, problem, grid, context).frames(stepper, Checkpoints(context, self.checkpoint_every))
