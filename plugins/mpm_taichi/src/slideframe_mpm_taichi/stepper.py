"""The particles and the grid in Taichi's memory, and the substep that moves them."""

from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.contact import ground_contact
from slideframe.device import Device
from slideframe.guards import STRETCH_BOUNDS
from slideframe.problem import LAWS, Grid, SimulationProblem
from slideframe.products import Filling
from slideframe.sparse_stepper import SparseStepper
from slideframe.tiles import MOST_DRIFT
from slideframe.time_integration import Step
from slideframe_mpm_taichi.layout import Layout
from slideframe_mpm_taichi.particles import Particles

# The series for log(1 + X) and exp(Y) - 1 end with the sixth power. Within this norm the first neglected
# term, of relative size norm^6 / 7, is below the rounding of the type.
SERIES_RADIUS = {"float32": 0.08, "float64": 0.003}


class Stepper(SparseStepper):
    """One simulation; Taichi must be kept ready by `runtime.session` as long as it lives."""

    def __init__(
        self, filling: Filling, problem: SimulationProblem, grid: Grid, device: Device, *, coloured: bool | None = None
    ) -> None:
        """Lay out the particles at t = 0, without stress.

        `coloured`: threads own tiles of nodes, colour by colour, as a processor's few do unless told otherwise; else
        they share nodes, as a card's thousands do.
        """
        super().__init__(filling, problem, grid)
        self.coloured = device.kind == "cpu" if coloured is None else coloured
        self.precision = problem.simulation.precision
        self.contact = ground_contact(filling, problem, grid)
        self.ground: tuple[Any, ...] = ()
        self.keeps_excess = not problem.simulation.transfer.constants.is_plain
        self.layout = Layout(problem.simulation, self.particles.count, device.kind == "cpu")

    def begin(self, step: Step) -> None:
        """Do all later substeps with `step`; stress terms made for another time step are made anew."""
        from slideframe_mpm_taichi import kernels

        before, settled, self.step = self.step.time_step, self.step.settling, step
        acting = self.problem.settling() if step.settling else self.problem
        if not self.ground or before == 0 or settled != step.settling:
            contact = self.contact.settling() if step.settling else self.contact
            self.ground = self._vectors(contact.columns, np.int32), self._vectors(contact.normals)
        grid, soil, boundary = self.grid, self._vectors([acting.material.constants]), acting.boundary
        radius, transfer = SERIES_RADIUS[self.precision], self.problem.simulation.transfer.constants
        self._update = (
            self._vectors([step.gravity]), step.time_step, step.kept, *self.ground, grid.padding, grid.high,
            boundary.sides.coefficient, boundary.floor.coefficient,
        )  # fmt: skip
        per_cell = step.time_step / grid.spacing
        self._motion = per_cell, self._vectors([transfer]), self._vectors(acting.limits(grid))
        self._law = 4.0 * per_cell, transfer.affine, LAWS.index(acting.material.law), soil, radius
        arrays = (self.particles[name] for name in ("pulls", "elastic_states", "volumes"))
        kernels.retime(*arrays, 4.0 * (before - step.time_step) / grid.spacing, soil, radius)

    def _vectors(self, values: npt.ArrayLike, kind: npt.DTypeLike = None) -> Any:
        """Return values (..., n) as an array of vectors of n, reals unless told otherwise."""
        import taichi as ti

        array = np.asarray(values, kind or self.precision)
        element = {"int32": ti.i32, "float32": ti.f32, "float64": ti.f64}[array.dtype.name]
        vectors = ti.ndarray(ti.types.vector(array.shape[-1], element), array.shape[:-1])
        vectors.from_numpy(array)
        return vectors

    def substep(self) -> float:
        """Advance by one time step, and return the greatest component of velocity, m/s; a huge one for NaN."""
        from slideframe_mpm_taichi import kernels

        if self.drift > MOST_DRIFT:
            self._sort()
        layout, particles = self.layout, self.particles
        where = (layout.columns, layout.corner, layout.across)
        apart = (layout.forces, self.keeps_excess)
        kernels.clear_grid(layout.nodes, layout.forces, layout.node_count, self.keeps_excess)
        moving = [particles[name] for name in ("positions", "velocities", "affines", "pulls", "masses")]
        if self.coloured:
            kernels.particles_to_grid(*moving, *where, layout.nodes, *apart, *layout.runs)
        else:
            kernels.particles_to_grid_atomic(*moving, *where, layout.nodes, *apart)
        kernels.update_grid(
            layout.nodes,
            layout.node_count,
            layout.columns,
            layout.owners,
            layout.corner,
            layout.across,
            *apart,
            *self._update,
        )
        names = ("positions", "residuals", "velocities", "affines", "pulls", "elastic_states")
        names += ("held", "masses", "volumes")
        gathered = (particles[name] for name in names)
        speed = float(kernels.grid_to_particles(layout.nodes, *apart, *where, *gathered, *self._motion))
        kernels.strain_particles(
            particles["affines"], particles["pulls"], self.keeps_excess, particles["elastic_states"],
            particles["volume_corrections"], particles["plastic_strains"], self.problem.simulation.record_stress,
            *(particles[name] for name in ("deformation_gradients", "masses", "volumes")), *self._law,
        )  # fmt: skip
        self.drift += speed * self.step.time_step / self.grid.spacing
        return speed

    def _sort(self) -> None:
        """Lay the grid anew, and bring the particles into the order of their cells where threads own tiles."""
        from slideframe_mpm_taichi import kernels

        self.layout.arrange(self.particles["positions"])
        if self.coloured:
            self.layout.sort(self.particles["positions"])
            for name in self.particles.names():
                kernels.reorder(self.layout.order, *self.particles.swap(name))
        self.drift = 0.0

    def _place_particles(self) -> Particles:
        return Particles(self.filling, self.problem, self.grid)

    def _bound_stretch(self) -> None:
        from slideframe_mpm_taichi import kernels

        kernels.bound_stretch(self.particles["deformation_gradients"], *STRETCH_BOUNDS)
