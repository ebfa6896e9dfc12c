"""The stage `mpm_taichi`."""

from collections.abc import Iterator
from typing import ClassVar

from slideframe.checkpoint import Checkpoints
from slideframe.explicit_solver import ExplicitSolver
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context
from slideframe.time_integration import March


class TaichiSolver(ExplicitSolver):
    """Explicit MLS-MPM on the CPU's cores or an NVIDIA card by Taichi."""

    name = "mpm_taichi"
    backend: ClassVar[tuple[str, ...]] = ("taichi",)
    # held, identities, one more while sorting, and sort keys and places
    integers_per_particle: ClassVar[int] = 1 + 1 + 1 + 1 + 1
    # the column of each node and its particles
    integers_per_node: ClassVar[int] = 2

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
