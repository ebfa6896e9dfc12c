"""The stage `mpm_warp`."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from pydantic import Field

from slideframe.checkpoint import Checkpoints
from slideframe.device import Device
from slideframe.errors import ConfigurationError
from slideframe.guards import Pace, check_memory, check_motion, check_start, start_frame
from slideframe.problem import ProblemModel, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context, Solver
from slideframe.tiles import estimate_nodes


class WarpSolver(Solver):
    """Explicit MLS-MPM on the CPU or an NVIDIA card by NVIDIA Warp."""

    name = "mpm_warp"
    backend: ClassVar[tuple[str, ...]] = ("warp",)
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
                "mpm_warp gives the same bits on the CPU only: on a card threads add to a node in any order",
                where="plugins.mpm_warp.deterministic",
                cure="use --device cpu, or set deterministic = false",
            )

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; on the CPU the same input gives the same bits."""
        from slideframe_mpm_warp.stepper import Stepper, bytes_needed

        grid = check_start(filling, problem)
        simulation, particle_count = problem.simulation, len(filling.particle_positions)
        node_count = estimate_nodes(filling, grid)
        check_memory(bytes_needed(particle_count, node_count, simulation.precision), particle_count, node_count)
        time_step, substeps = problem.time_step(grid)
        masses = problem.material.density * filling.particle_volumes.astype(np.float64)
        pace = Pace(context, simulation, masses, time_step)
        checkpoints = Checkpoints(context, self.checkpoint_every)
        found = checkpoints.latest()
        first = found[0] + 1 if found else 1
        if not found:
            yield start_frame(filling, problem)

        stepper = Stepper(filling, problem, grid, str(context.device))
        if found:
            stepper.restore(found[1])
            pace.resume(int(found[1]["substeps"]))
            found = None  # its arrays
        for frame in range(first, simulation.frame_count):
            with pace:
                for substep in range(1, substeps + 1):
                    # written so that NaN, too, is found
                    if not stepper.substep() * time_step <= grid.spacing:
                        now = (frame - 1) / simulation.frame_rate + substep * time_step
                        check_motion(*stepper.motion(), now, grid, time_step)
            product = stepper.frame(frame / simulation.frame_rate)
            pace.frame_done(frame, substeps, product)
            yield product
            if checkpoints.is_due(frame):
                checkpoints.write(frame, stepper.state() | {"substeps": np.array(pace.substeps)})
