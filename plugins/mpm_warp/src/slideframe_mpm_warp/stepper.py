"""The substep that moves the particles over the grid and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from slideframe.contact import ContactNodes, ground_contact
from slideframe.guards import STRETCH_BOUNDS
from slideframe.problem import LAWS, Grid, SimulationProblem
from slideframe.products import Filling
from slideframe.sparse_stepper import SparseStepper
from slideframe.tiles import MOST_DRIFT
from slideframe.time_integration import Step
from slideframe_mpm_warp.cores import Cores
from slideframe_mpm_warp.layout import Layout
from slideframe_mpm_warp.particles import Particles
from slideframe_mpm_warp.runtime import kernels_in

JACOBI_SWEEPS = 6


class Stepper(SparseStepper):
    """One simulation on one device; a value of `filling` and `problem` until `substep` is called."""

    def __init__(
        self, filling: Filling, problem: SimulationProblem, grid: Grid, device: str, *, coloured: bool | None = None
    ) -> None:
        """Lay out the particles at t = 0, without stress.

        `coloured`: threads own tiles of nodes, colour by colour, as a processor's few do unless told otherwise; else
        they share nodes, as a card's thousands do.
        """
        import warp as wp

        self.coloured = device == "cpu" if coloured is None else coloured
        self.device = device
        self.kernels: Any = kernels_in(
            problem.simulation.precision, device, not self.coloured, not problem.simulation.transfer.constants.is_plain
        )
        super().__init__(filling, problem, grid)
        self.contact = ground_contact(filling, problem, grid)
        self.ground: tuple[Any, ...] = ()
        self.layout = Layout(self.kernels, device, self.particles.count)
        self.cores = Cores(self.particles.count if self.coloured else 1)
        chunks = -(-self.particles.count // self.kernels.CHUNK)
        self.fastest: Any = wp.zeros(chunks, dtype=self.kernels.Real, device=device)
        self._phases: list[list[Any]] = []

    def begin(self, step: Step) -> None:
        """Do all later substeps with `step`; stress terms made for another time step are made anew."""
        before, settled, self.step = self.step.time_step, self.step.settling, step
        if not self.ground or before == 0 or settled != step.settling:
            self.acting = self.problem.settling() if step.settling else self.problem
            self.ground = self._ground(self.contact.settling() if step.settling else self.contact)
        even = _even_runs(self.particles.count, self.cores.count)
        arrays = [self.particles[name] for name in ("pulls", "elastic_states", "volumes")]
        change = 4.0 * (before - step.time_step) / self.grid.spacing
        soil = self.kernels.Soil(*self.problem.material.constants)
        self.cores.run(self._record(self.kernels.retime, even, *arrays, change, soil, JACOBI_SWEEPS))
        if self._phases:
            self._prepare()

    def _ground(self, contact: ContactNodes) -> tuple[Any, Any]:
        """Return where solid ground acts, in Warp's memory."""
        import warp as wp

        normals = contact.normals.astype(np.dtype(self.kernels.Real.__name__))
        with wp.ScopedDevice(self.device):
            return wp.array(contact.columns, dtype=wp.vec3i), wp.array(normals, dtype=self.kernels.Vector4)

    def substep(self) -> float:
        """Advance by one time step, and return the greatest component of velocity, m/s; infinity for NaN."""
        if self.drift > MOST_DRIFT:
            self._sort()
        self.layout.nodes.zero_()
        if self.kernels.KEEPS_EXCESS:
            self.layout.forces.zero_()
        self.fastest.zero_()
        for parts in self._phases:
            self.cores.run(parts)
        speed = float(self.fastest.numpy().max())
        self.drift += speed * self.step.time_step / self.grid.spacing
        return speed

    def _sort(self) -> None:
        """Lay the grid anew, bring the particles into the order of their cells, and prepare the launches."""
        self.layout.arrange(self.particles["positions"])
        even = _even_runs(self.particles.count, self.cores.count)
        for name in self.particles.names():
            source, target = self.particles.swap(name)
            self.cores.run(self._record(self.kernels.reorder, even, self.layout.order, source, target))
        self.drift = 0.0
        self._prepare()

    def _prepare(self) -> None:
        """Record the launches of a substep, phase by phase; the parts of one phase write to disjoint memory."""
        import warp as wp

        kernels, layout, particles = self.kernels, self.layout, self.particles
        where = [layout.columns, layout.corner, layout.across]
        moving = (particles[name] for name in ("positions", "velocities", "affines", "pulls", "masses"))
        scattered = [*moving, *where, layout.nodes, layout.forces]
        runs = layout.cut(self.cores.count) if self.coloured else [[(0, particles.count)]]
        self._phases = [self._record(kernels.particles_to_grid, run, *scattered) for run in runs if run]

        boundary, change = self.acting.boundary, self.step.time_step * np.array(self.step.gravity)
        even = _even_runs(layout.node_count, self.cores.count)
        self._phases += [self._record(
            kernels.update_grid, even, layout.nodes, layout.columns, layout.owners, layout.corner, layout.across,
            layout.forces, kernels.Vector(*change), self.step.kept, *self.ground, self.grid.padding,
            wp.vec2i(*self.grid.high), kernels.Vector2(boundary.sides.coefficient, boundary.floor.coefficient),
        )]  # fmt: skip

        names = ("positions", "residuals", "velocities", "affines", "pulls", "elastic_states")
        names += ("held", "masses", "volumes")
        per_cell, transfer = self.step.time_step / self.grid.spacing, self.problem.simulation.transfer.constants
        even = _even_runs(particles.count, self.cores.count, kernels.CHUNK)
        self._phases += [self._record(
            kernels.grid_to_particles, even, layout.nodes, layout.forces, *where, *(particles[name] for name in names),
            self.fastest, per_cell, kernels.Vector(*transfer),
            *(kernels.Vector(*limit) for limit in self.problem.limits(self.grid)),
        )]  # fmt: skip
        self._phases += [self._record_strain(even, 4.0 * per_cell, transfer.affine)]

    def _record_strain(self, runs: Sequence[tuple[int, int]], scale: float, affine_share: float) -> list[Any]:
        """Return the launches that strain each run of particles, LANES at once."""
        import warp as wp

        kernels, soil = self.kernels, self.acting.material
        names = ("affines", "pulls", "elastic_states", "volume_corrections", "plastic_strains", "deformation_gradients")
        arrays = [self.particles[name] for name in (*names, "masses", "volumes")]
        constants = [scale, affine_share, LAWS.index(soil.law), kernels.Soil(*soil.constants), JACOBI_SWEEPS]
        return [
            wp.launch(
                kernels.strain_particles,
                dim=-(-count // int(kernels.LANES)),
                inputs=[first, first + count, *arrays, *constants],
                device=self.device,
                record_cmd=True,
            )
            for first, count in runs
        ]

    def _record(self, kernel: Any, runs: Sequence[tuple[int, int]], *inputs: Any) -> list[Any]:
        """Return one launch of a kernel for each run (first, count)."""
        import warp as wp

        return [
            wp.launch(kernel, dim=count, inputs=[first, *inputs], device=self.device, record_cmd=True)
            for first, count in runs
        ]

    def _place_particles(self) -> Particles:
        return Particles(self.filling, self.problem, self.grid, self.kernels, self.device)

    def _bound_stretch(self) -> None:
        even = _even_runs(self.particles.count, self.cores.count)
        inputs = [self.particles["deformation_gradients"], *STRETCH_BOUNDS, JACOBI_SWEEPS]
        self.cores.run(self._record(self.kernels.bound_stretch, even, *inputs))


def _even_runs(count: int, parts: int, grain: int = 1) -> list[tuple[int, int]]:
    """Return at most `parts` runs (first, count) of a whole, cut at multiples of `grain`."""
    length = max(grain, -(-count // (parts * grain)) * grain)
    return [(first, min(length, count - first)) for first in range(0, count, length)]
