"""The particles and the grid in Warp's memory, and the substep that moves them."""

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.guards import STRETCH_BOUNDS
from slideframe.problem import LAWS, Grid, SimulationProblem, Wall
from slideframe.products import Filling, ParticleFrame
from slideframe_mpm_warp.runtime import kernels_in

WALL_KINDS = {"slip": 0, "stick": 1, "friction": 2}
JACOBI_SWEEPS = 6

# positions, residuals, velocities, affines, elastic states, volume corrections, deformation gradients, masses, volumes
REALS_PER_PARTICLE = 3 + 3 + 3 + 9 + 6 + 1 + 9 + 1 + 1
REALS_PER_NODE = 4


class Stepper:
    """One simulation on one device; a value of `filling` and `problem` until `substep` is called."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid, device: str) -> None:
        """Lay out the particles at t = 0, without stress."""
        precision = problem.simulation.precision
        self.grid = grid
        self.device = device
        self.kernels: ModuleType = kernels_in(precision, device)
        self.time_step, _ = problem.time_step(grid)
        self._allocate(filling, problem.material.density, np.dtype(precision))
        self._arrange(problem)

    def _allocate(self, filling: Filling, density: float, real: "np.dtype[Any]") -> None:
        import warp as wp

        kernels, count = self.kernels, len(filling.particle_positions)
        cells = (filling.particle_positions.astype(np.float64) - np.array(self.grid.origin)) / self.grid.spacing
        volumes = filling.particle_volumes.astype(np.float64)
        identity = np.tile(np.eye(3, dtype=real), (count, 1, 1))
        with wp.ScopedDevice(self.device):
            self.positions: Any = wp.array(cells.astype(real), dtype=kernels.Vector)
            self.residuals: Any = wp.zeros(count, dtype=kernels.Vector)
            self.velocities: Any = wp.array(filling.start_velocities().astype(real), dtype=kernels.Vector)
            self.affines: Any = wp.zeros(count, dtype=kernels.Matrix)
            self.elastic_states: Any = wp.zeros(count, dtype=kernels.Vector6)
            self.volume_corrections: Any = wp.zeros(count, dtype=kernels.Real)
            self.deformation_gradients: Any = wp.array(identity, dtype=kernels.Matrix)
            self.held: Any = wp.zeros(count, dtype=wp.int32)
            self.masses: Any = wp.array((density * volumes).astype(real), dtype=kernels.Real)
            self.volumes: Any = wp.array(volumes.astype(real), dtype=kernels.Real)
            self.nodes: Any = wp.zeros(self.grid.shape, dtype=kernels.Vector4)

    def _arrange(self, problem: SimulationProblem) -> None:
        """Order the arguments of the three launches of a substep, once."""
        import warp as wp

        kernels, grid, soil, boundary = self.kernels, self.grid, problem.material, problem.boundary
        walls: tuple[Wall, Wall] = (boundary.sides, boundary.floor)
        stride = wp.vec2i(grid.shape[1] * grid.shape[2], grid.shape[2])
        flat = self.nodes.flatten()
        gravity = np.array(problem.simulation.gravity) * self.time_step
        self._scatter = [self.positions, self.velocities, self.affines, self.masses, stride, flat]
        self._update = [
            self.nodes,
            kernels.Vector(*gravity),
            grid.padding,
            wp.vec2i(*grid.high),
            wp.vec2i(*(WALL_KINDS[wall.kind] for wall in walls)),
            kernels.Vector2(*(wall.friction for wall in walls)),
        ]
        self._gather = [
            flat, stride, self.positions, self.residuals, self.velocities, self.affines, self.elastic_states,
            self.volume_corrections, self.deformation_gradients, self.held, self.masses, self.volumes,
            self.time_step, grid.spacing, LAWS.index(soil.law), kernels.Soil(*soil.constants),
            kernels.Vector(*(length - 2.0 for length in grid.shape)), JACOBI_SWEEPS,
        ]  # fmt: skip

    def substep(self) -> None:
        """Advance by one time step."""
        import warp as wp

        kernels, count = self.kernels, len(self.positions)
        with wp.ScopedDevice(self.device):
            self.nodes.zero_()
            wp.launch(kernels.particles_to_grid, dim=count, inputs=self._scatter)
            wp.launch(kernels.update_grid, dim=self.grid.shape, inputs=self._update)
            wp.launch(kernels.grid_to_particles, dim=count, inputs=self._gather)

    def motion(self) -> tuple[Float64Array, npt.NDArray[np.floating]]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s, as they are now."""
        cells = self.positions.numpy().astype(np.float64)
        return cells * self.grid.spacing + np.array(self.grid.origin), self.velocities.numpy()

    def escaped(self) -> int:
        """Return how many particles have been held at the grid's edge."""
        return int(np.count_nonzero(self.held.numpy()))

    def frame(self, time: float) -> ParticleFrame:
        """Return copies of the state, after bounding the stretch of the rendering frames."""
        import warp as wp

        with wp.ScopedDevice(self.device):
            inputs = [self.deformation_gradients, *STRETCH_BOUNDS, JACOBI_SWEEPS]
            wp.launch(self.kernels.bound_stretch, dim=len(self.positions), inputs=inputs)
        positions, velocities = self.motion()
        return ParticleFrame(
            time=time,
            positions=positions.astype(np.float32),
            # .numpy() shows Warp's own memory on the CPU, and astype copies it
            velocities=velocities.astype(np.float32),
            deformation_gradients=self.deformation_gradients.numpy().astype(np.float32),
            escaped=self.escaped(),
        )
