"""The stage `mpm_taichi`."""

from collections.abc import Iterator
from typing import ClassVar

from pydantic import Field

from slideframe.checkpoint import Checkpoints
from slideframe.device import Device
from slideframe.errors import ConfigurationError
from slideframe.guards import check_memory, check_start
from slideframe.problem import FEATURES, ProblemModel, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context, Solver
from slideframe.tiles import estimate_nodes
from slideframe.time_integration import March


class TaichiSolver(Solver):
    """Explicit MLS-MPM on the CPU's cores or an NVIDIA card by Taichi."""

    name = "mpm_taichi"
    features: ClassVar[frozenset[str]] = FEATURES
    backend: ClassVar[tuple[str, ...]] = ("taichi",)
    devices: ClassVar[frozenset[str]] = frozenset({"cpu", "cuda"})

    checkpoint_every: int = Field(
        default=10,
        ge=0,
        description="output frames from one checkpoint to the next, for a run that breaks off; 0: none",
    )

    deterministic: bool = Field(
        default=False, description="insist on the same bits in every run: always so on the CPU, refused on a card"
    )

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Refuse to promise on a card what only the CPU holds."""
        if self.deterministic and device.kind != "cpu":
            raise ConfigurationError(
                "mpm_taichi gives the same bits on the CPU only: on a card threads add to a node in any order",
                where="plugins.mpm_taichi.deterministic",
                cure="use --device cpu, or set deterministic = false",
            )

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; on the CPU the same input gives the same bits, whatever the number of threads."""
        from slideframe_mpm_taichi.runtime import session
        from slideframe_mpm_taichi.stepper import Stepper, bytes_needed

        grid = check_start(filling, problem)
        simulation, particle_count = problem.simulation, len(filling.particle_positions)
        node_count = estimate_nodes(filling, grid)
        check_memory(bytes_needed(particle_count, node_count, simulation), particle_count, node_count)
        with session(context.device, simulation.precision):
            stepper = Stepper(filling, problem, grid, context.device)
            yield from March(filling, problem, grid, context).frames(
                stepper, Checkpoints(context, self.checkpoint_every)
            )
