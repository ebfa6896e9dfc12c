"""What explicit solvers on a sparse grid share but for their kernels: options, promises, and the checks of a start."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from slideframe.device import Device
from slideframe.errors import ConfigurationError
from slideframe.guards import check_memory, check_start
from slideframe.problem import FEATURES, Grid, ProblemModel, Simulation, SimulationProblem
from slideframe.products import Filling
from slideframe.sorted_particles import reals_per_particle
from slideframe.stages import Solver
from slideframe.tiles import estimate_nodes

# momentum and mass; where a transfer keeps the impulse of stress apart, as many again
REALS_PER_NODE = 4


class ExplicitSolver(Solver):
    """A solver that keeps checkpoints, and gives the same bits on the CPU where it owns tiles of nodes by threads.

    A backend states the integers that it keeps beside the reals, which are the same in all.
    """

    features: ClassVar[frozenset[str]] = FEATURES
    devices: ClassVar[frozenset[str]] = frozenset({"cpu", "cuda"})
    integers_per_particle: ClassVar[int]
    integers_per_node: ClassVar[int]

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
                f"{self.name} gives the same bits on the CPU only: on a card threads add to a node in any order",
                where=f"plugins.{self.name}.deterministic",
                cure="use --device cpu, or set deterministic = false",
            )

    def bytes_needed(self, particle_count: int, node_count: int, simulation: Simulation) -> int:
        """Return the memory that a simulation takes."""
        per_node = REALS_PER_NODE * (1 if simulation.transfer.constants.is_plain else 2)
        reals = particle_count * reals_per_particle(simulation) + node_count * per_node
        integers = particle_count * self.integers_per_particle + node_count * self.integers_per_node
        return reals * np.dtype(simulation.precision).itemsize + integers * np.dtype(np.int32).itemsize

    def least_memory(self, particle_count: float, simulation: Simulation) -> float:
        """Return the bytes that so many particles take at least, in cells that are all full."""
        return self.bytes_needed(
            round(particle_count), round(particle_count / simulation.particles_per_cell), simulation
        )

    def sound_grid(self, filling: Filling, problem: SimulationProblem) -> Grid:
        """Return the grid of a start that is sound and fits into memory; nothing has been allocated by then.

        Raises:
            ConfigurationError: the cells are too large, or the simulation too large for memory.
            InputError: particles are missing, outside the walls, without volume, or not finite.
        """
        grid = check_start(filling, problem)
        particle_count, node_count = len(filling.particle_positions), estimate_nodes(filling, grid)
        check_memory(self.bytes_needed(particle_count, node_count, problem.simulation), particle_count, node_count)
        return grid
