"""The particles and the grid in Taichi's memory, and the substep that moves them."""

from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.device import Device
from slideframe.guards import STRETCH_BOUNDS
from slideframe.problem import LAWS, Grid, LawConstants, SimulationProblem, Wall
from slideframe.products import Filling, ParticleFrame

WALL_KINDS = {"slip": 0, "stick": 1, "friction": 2}

# The series for log(1 + X) and exp(Y) - 1 end with the sixth power. Within this norm the first neglected
# term, of relative size norm^6 / 7, is below the rounding of the type.
SERIES_RADIUS = {"float32": 0.08, "float64": 0.003}

# Slabs of equal colour share no node while particles stay within one cell of where they were sorted; the rest is for
# the rounding of positions and of this sum.
MOST_DRIFT = 0.9

# positions, residuals, velocities, affines, elastic states, volume corrections, deformation gradients, masses, volumes,
# held and identities; twice, since sorting copies
REALS_PER_PARTICLE = 2 * (3 + 3 + 3 + 9 + 6 + 1 + 9 + 1 + 1 + 1 + 1)
# momentum and mass, and the start of each cell
REALS_PER_NODE = 4 + 1


class Stepper:
    """One simulation; Taichi must be kept ready by `runtime.session` as long as it lives."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid, device: Device) -> None:
        """Lay out particles at rest, without stress."""
        self.grid = grid
        self.count = len(filling.particle_positions)
        self.precision = problem.simulation.precision
        self.time_step, _ = problem.time_step(grid)
        self.coloured = device.kind == "cpu"
        self.stride = (grid.shape[1] * grid.shape[2], grid.shape[2])
        # a bound on how far, in cells, a particle has moved since the last sort; unsorted at first
        self.drift = np.inf
        self._allocate(filling, problem.material.density, problem.simulation.gravity)
        self._arrange(problem)

    def _allocate(self, filling: Filling, density: float, gravity: tuple[float, float, float]) -> None:
        import taichi as ti

        from slideframe_mpm_taichi.kernels import CHUNK, SLAB_WIDTH

        real = ti.f64 if self.precision == "float64" else ti.f32
        vector, matrix = ti.types.vector(3, real), ti.types.matrix(3, 3, real)
        cells = (filling.particle_positions.astype(np.float64) - np.array(self.grid.origin)) / self.grid.spacing
        volumes = filling.particle_volumes.astype(np.float64)
        start = {
            "positions": (vector, cells),
            "residuals": (vector, np.zeros((self.count, 3))),
            "velocities": (vector, filling.start_velocities()),
            "affines": (matrix, np.zeros((self.count, 3, 3))),
            "elastic_states": (ti.types.vector(6, real), np.zeros((self.count, 6))),
            "volume_corrections": (real, np.zeros(self.count)),
            "deformation_gradients": (matrix, np.tile(np.eye(3), (self.count, 1, 1))),
            "masses": (real, density * volumes),
            "volumes": (real, volumes),
            "held": (ti.i32, np.zeros(self.count)),
            "identities": (ti.i32, np.arange(self.count)),
        }
        self.particles: dict[str, Any] = {name: ti.ndarray(element, self.count) for name, (element, _) in start.items()}
        self.spares: dict[str, Any] = {name: ti.ndarray(element, self.count) for name, (element, _) in start.items()}
        for name, (_, values) in start.items():
            array = self.particles[name]
            array.from_numpy(values.astype(array.to_numpy().dtype))
        self.gravity = ti.ndarray(vector, 1)
        self.gravity.from_numpy(np.array([gravity], self.precision))
        self.nodes = ti.ndarray(ti.types.vector(4, real), self.grid.node_count)
        self.fastest = ti.ndarray(real, -(-self.count // CHUNK))
        self.order = ti.ndarray(ti.i32, self.count)
        self.cell_starts = ti.ndarray(ti.i32, self.grid.node_count)
        pairs = -(-self.grid.shape[0] // (2 * SLAB_WIDTH))
        self.slab_starts = ti.ndarray(ti.i32, 2 * pairs + 1)

    def _arrange(self, problem: SimulationProblem) -> None:
        """Order the arguments of a substep's launches that stay the same, once."""
        grid, soil, boundary = self.grid, problem.material, problem.boundary
        walls: tuple[Wall, Wall] = (boundary.sides, boundary.floor)
        self.soils = self._soils(soil.constants)
        self._update = (
            grid.shape,
            self.gravity,
            self.time_step,
            grid.padding,
            grid.high,
            tuple(WALL_KINDS[wall.kind] for wall in walls),
            *(wall.friction for wall in walls),
        )
        self._constants = (
            self.time_step, grid.spacing, LAWS.index(soil.law), self.soils,
            grid.shape, SERIES_RADIUS[self.precision],
        )  # fmt: skip

    def _soils(self, constants: LawConstants) -> Any:
        """Return the constants of the soil as an array of one vector."""
        import taichi as ti

        real = ti.f64 if self.precision == "float64" else ti.f32
        soils = ti.ndarray(ti.types.vector(len(constants), real), 1)
        soils.from_numpy(np.array([constants], self.precision))
        return soils

    def substep(self) -> None:
        """Advance by one time step."""
        from slideframe_mpm_taichi import kernels

        if self.coloured and self.drift > MOST_DRIFT:
            self._sort()
        self.nodes.fill(0.0)
        particles = self.particles
        moving = [particles[name] for name in ("positions", "velocities", "affines", "masses")]
        if self.coloured:
            for parity in (0, 1):
                kernels.particles_to_grid(*moving, self.stride, self.slab_starts, parity, self.nodes)
        else:
            kernels.particles_to_grid_atomic(*moving, self.stride, self.nodes)
        kernels.update_grid(self.nodes, *self._update)
        names = (
            "positions", "residuals", "velocities", "affines", "elastic_states", "volume_corrections",
            "deformation_gradients", "held", "masses", "volumes",
        )  # fmt: skip
        kernels.grid_to_particles(
            self.nodes, self.stride, *(particles[name] for name in names), *self._constants, self.fastest
        )
        if self.coloured:
            fastest = float(self.fastest.to_numpy().max())
            self.drift += fastest * self.time_step / self.grid.spacing

    def _sort(self) -> None:
        """Bring the particles into the order of their cells."""
        from slideframe_mpm_taichi.kernels import sorting

        positions = self.particles["positions"]
        sorting.count_cells(positions, self.stride, self.cell_starts)
        sorting.split_slabs(self.cell_starts, self.stride, self.count, self.slab_starts)
        sorting.rank_particles(positions, self.stride, self.cell_starts, self.order)
        for name, array in self.particles.items():
            sorting.reorder(self.order, array, self.spares[name])
        self.particles, self.spares = self.spares, self.particles
        self.drift = 0.0

    def motion(self) -> tuple[Float64Array, npt.NDArray[np.floating]]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s, in the order of the filling."""
        cells = self._in_order("positions").astype(np.float64)
        return cells * self.grid.spacing + np.array(self.grid.origin), self._in_order("velocities")

    def _in_order(self, name: str) -> npt.NDArray[Any]:
        """Return a copy of one array, by the particles' identities."""
        sorted_values: npt.NDArray[Any] = self.particles[name].to_numpy()
        values = np.empty_like(sorted_values)
        values[self.particles["identities"].to_numpy()] = sorted_values
        return values

    def frame(self, time: float) -> ParticleFrame:
        """Return copies of the state, after bounding the stretch of the rendering frames."""
        from slideframe_mpm_taichi import kernels

        kernels.bound_stretch(self.particles["deformation_gradients"], *STRETCH_BOUNDS)
        positions, velocities = self.motion()
        return ParticleFrame(
            time=time,
            positions=positions.astype(np.float32),
            velocities=velocities.astype(np.float32),
            deformation_gradients=self._in_order("deformation_gradients").astype(np.float32),
            escaped=int(np.count_nonzero(self.particles["held"].to_numpy())),
        )
