"""The stage `mpm_flip`: explicit MPM with nodal forces and a PIC/FLIP transfer."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from slideframe.arrays import Float64Array
from slideframe.guards import Pace, check_motion, check_start, start_frame
from slideframe.problem import Grid, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.reference.constitutive import kirchhoff_stress, return_mapping
from slideframe.reference.solver import Particles, Stencil, apply_walls, bound_stretch, scatter
from slideframe.stages import Context, Solver


class FlipSolver(Solver):
    """Explicit MPM whose particles keep most of their own velocity (PIC/FLIP)."""

    name = "mpm_flip"

    flip_share: float = Field(
        default=0.98, ge=0, le=1, description="share of FLIP in the velocity: 0 damps strongly, 1 not at all"
    )

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion."""
        grid = check_start(filling, problem)
        time_step, substeps = problem.time_step(grid)
        state = Particles.at_start(filling, problem.material.density)
        simulation = problem.simulation
        pace = Pace(context, problem.simulation, state.masses, time_step)
        yield start_frame(filling, problem)
        for frame in range(1, simulation.frame_count):
            with pace:
                for substep in range(1, substeps + 1):
                    self._advance(state, problem, grid, time_step)
                    now = (frame - 1) / simulation.frame_rate + substep * time_step
                    check_motion(state.positions, state.velocities, now, grid, time_step)
            bound_stretch(state.deformation_gradients)
            product = state.frame(frame / simulation.frame_rate, problem)
            pace.frame_done(frame, substeps, product)
            yield product

    def _advance(self, state: Particles, problem: SimulationProblem, grid: Grid, time_step: float) -> None:
        """Carry the particles through one substep."""
        stencil = Stencil.around(state.positions, grid)
        gradients = weight_gradients(stencil, grid)
        mass = scatter(stencil.weights * state.masses[:, None], stencil, grid)
        momentum = np.stack(
            [scatter(stencil.weights * (state.masses * v)[:, None], stencil, grid) for v in state.velocities.T], axis=1
        )
        # f = -sum of V0 tau grad w (Stomakhin et al. 2013, eq. 6)
        pull = np.einsum("p,pij,pnj->ipn", state.volumes, kirchhoff_stress(state.elastic, problem.material), gradients)
        force = -np.stack([scatter(component, stencil, grid) for component in pull], axis=1)

        heavy = mass[:, None] > 0
        before = np.divide(momentum, mass[:, None], out=np.zeros_like(momentum), where=heavy)
        after = before + time_step * np.divide(force, mass[:, None], out=np.zeros_like(force), where=heavy)
        after += time_step * np.array(problem.simulation.gravity) * heavy
        apply_walls(after.reshape(*grid.shape, 3), problem.boundary, grid)
        self._follow(state, stencil, gradients, before, after, problem, grid, time_step)

    def _follow(
        self,
        state: Particles,
        stencil: Stencil,
        gradients: Float64Array,
        before: Float64Array,
        after: Float64Array,
        problem: SimulationProblem,
        grid: Grid,
        time_step: float,
    ) -> None:
        """Move and strain the particles with the grid's velocities (nodes, 3) before and after the forces acted."""
        old, new = before[stencil.nodes], after[stencil.nodes]
        carried = np.einsum("pn,pni->pi", stencil.weights, new)
        gained = np.einsum("pn,pni->pi", stencil.weights, new - old)
        state.velocities = (1 - self.flip_share) * carried + self.flip_share * (state.velocities + gained)
        change = np.eye(3) + time_step * np.einsum("pni,pnj->pij", new, gradients)
        state.deformation_gradients = change @ state.deformation_gradients
        flow = return_mapping(change @ state.elastic, state.volume_corrections, problem.material)
        state.elastic, state.volume_corrections = flow.elastic, flow.volume_correction
        moved = state.positions + time_step * carried
        low, high = grid.spacing, grid.spacing * (np.array(grid.shape) - 2)
        state.positions = np.clip(moved - grid.origin, low, high) + grid.origin
        state.held |= (state.positions != moved).any(axis=1)


def weight_gradients(stencil: Stencil, grid: Grid) -> Float64Array:
    """Return the gradients (n, 27, 3), 1/m, of the quadratic B-splines of a stencil."""
    # d = node minus particle in cells; w(d) = 3/4 - d^2 within half a cell, (3/2 - |d|)^2 / 2 beyond
    d = stencil.arms / grid.spacing
    reach = np.abs(d)
    weights = np.where(reach < 0.5, 0.75 - d * d, 0.5 * (1.5 - reach) ** 2)
    slopes = np.where(reach < 0.5, 2 * d, np.sign(d) * (1.5 - reach)) / grid.spacing
    x, y, z = weights[..., 0], weights[..., 1], weights[..., 2]
    return np.stack([slopes[..., 0] * y * z, x * slopes[..., 1] * z, x * y * slopes[..., 2]], axis=-1)
