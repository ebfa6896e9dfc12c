"""The stage `mpm_flip`: explicit MPM with nodal forces and a PIC/FLIP transfer."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from pydantic import Field

from slideframe.arrays import Float64Array
from slideframe.guards import check_start
from slideframe.problem import Grid, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.reference.constitutive import kirchhoff_stress, return_mapping
from slideframe.reference.solver import ReferenceStepper, Stencil, apply_contact, apply_walls, carry, scatter
from slideframe.stages import Context, Solver
from slideframe.time_integration import March


class FlipSolver(Solver):
    """Explicit MPM whose particles keep most of their own velocity (PIC/FLIP)."""

    name = "mpm_flip"
    features: ClassVar[frozenset[str]] = frozenset(
        {"elastic", "drucker_prager", "mohr_coulomb", "open_walls", "terrain", "meshes", "initial_stress", "rest"}
    )

    flip_share: float = Field(
        default=0.98, ge=0, le=1, description="share of FLIP in the velocity: 0 damps strongly, 1 not at all"
    )

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion."""
        grid = check_start(filling, problem)
        yield from March(filling, problem, grid, context).frames(FlipStepper(filling, problem, grid, self.flip_share))


class FlipStepper(ReferenceStepper):
    """The reference's particles, carried from step to step by PIC/FLIP."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid, flip_share: float) -> None:
        """Lay out the particles at t = 0, without stress."""
        super().__init__(filling, problem, grid)
        self.flip_share = flip_share

    def substep(self) -> float:
        """Advance by one time step; return the greatest component of velocity, m/s."""
        problem, contact = self.acting
        state, grid, time_step = self.state, self.grid, self.step.time_step
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
        after = self.step.kept * (after + time_step * np.array(self.step.gravity) * heavy)
        apply_contact(after.reshape(*grid.shape, 3), contact)
        apply_walls(after.reshape(*grid.shape, 3), problem.boundary, grid)
        self._follow(stencil, gradients, before, after, problem)
        return float(np.abs(state.velocities).max())

    def _follow(
        self,
        stencil: Stencil,
        gradients: Float64Array,
        before: Float64Array,
        after: Float64Array,
        problem: SimulationProblem,
    ) -> None:
        """Move and strain the particles with the grid's velocities (nodes, 3) before and after the forces acted."""
        state, time_step = self.state, self.step.time_step
        # what has left the domain weighs nothing and stays where it left
        staying = (state.masses > 0)[:, None]
        old, new = before[stencil.nodes], after[stencil.nodes]
        carried = staying * np.einsum("pn,pni->pi", stencil.weights, new)
        gained = np.einsum("pn,pni->pi", stencil.weights, new - old)
        state.velocities = staying * ((1 - self.flip_share) * carried + self.flip_share * (state.velocities + gained))
        change = np.eye(3) + time_step * staying[:, None] * np.einsum("pni,pnj->pij", new, gradients)
        state.deformation_gradients = change @ state.deformation_gradients
        flow = return_mapping(change @ state.elastic, state.volume_corrections, problem.material)
        state.elastic, state.volume_corrections = flow.elastic, flow.volume_correction
        carry(state, time_step * carried, problem, self.grid)


def weight_gradients(stencil: Stencil, grid: Grid) -> Float64Array:
    """Return the gradients (n, 27, 3), 1/m, of the quadratic B-splines of a stencil."""
    # d = node minus particle in cells; w(d) = 3/4 - d^2 within half a cell, (3/2 - |d|)^2 / 2 beyond
    d = stencil.arms / grid.spacing
    reach = np.abs(d)
    weights = np.where(reach < 0.5, 0.75 - d * d, 0.5 * (1.5 - reach) ** 2)
    slopes = np.where(reach < 0.5, 2 * d, np.sign(d) * (1.5 - reach)) / grid.spacing
    x, y, z = weights[..., 0], weights[..., 1], weights[..., 2]
    return np.stack([slopes[..., 0] * y * z, x * slopes[..., 1] * z, x * y * slopes[..., 2]], axis=-1)
