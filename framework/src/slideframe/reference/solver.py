"""An explicit Material Point Method that is read and trusted rather than fast."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.contact import ContactNodes, ground_contact
from slideframe.guards import STRETCH_BOUNDS, check_memory, check_start
from slideframe.problem import FEATURES, Boundary, Grid, SimulationProblem, Wall
from slideframe.problem.boundary import STICKS
from slideframe.problem.transfer import LOOSE_STRAIN
from slideframe.products import Filling, ParticleFrame
from slideframe.reference.constitutive import kirchhoff_stress, return_mapping
from slideframe.stages import Context, Solver
from slideframe.stress import stress_fields
from slideframe.time_integration import March, Step

BYTES_PER_PARTICLE = 27 * 8 * 12
BYTES_PER_NODE = 4 * 8 * 3


class ReferenceSolver(Solver):
    """Explicit MLS-MPM in float64 NumPy: quadratic B-splines, every transfer and law (Hu et al. 2018)."""

    name = "reference"
    features: ClassVar[frozenset[str]] = FEATURES

    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield the motion; always in float64, whatever `precision` says."""
        grid = check_start(filling, problem)
        particle_count = len(filling.particle_positions)
        check_memory(
            particle_count * BYTES_PER_PARTICLE + grid.node_count * BYTES_PER_NODE, particle_count, grid.node_count
        )
        yield from March(filling, problem, grid, context).frames(ReferenceStepper(filling, problem, grid))


class ReferenceStepper:
    """One simulation in NumPy's memory."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid) -> None:
        """Lay out the particles at t = 0, without stress."""
        self.filling, self.problem, self.grid = filling, problem, grid
        self.contact = ground_contact(filling, problem, grid)
        self.state = Particles.at_start(filling, problem.material.density)
        self.step = Step(0.0, (0.0, 0.0, 0.0))

    def begin(self, step: Step) -> None:
        """Do all later substeps with `step`."""
        self.step = step

    @property
    def acting(self) -> tuple[SimulationProblem, ContactNodes]:
        """The problem and the ground as they act in the present step."""
        if self.step.settling:
            return self.problem.settling(), self.contact.settling()
        return self.problem, self.contact

    def substep(self) -> float:
        """Advance by one time step; return the greatest component of velocity, m/s."""
        advance(self.state, *self.acting, self.grid, self.step)
        return float(np.abs(self.state.velocities).max())

    def load(self, hencky: Float64Array) -> None:
        """Take elastic Hencky strains (n, 3, 3) as the state."""
        values, vectors = np.linalg.eigh(hencky)
        self.state.elastic = (vectors * np.exp(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2)

    def restart(self) -> None:
        """Put the particles back where they were at t = 0 and keep their stress."""
        elastic = self.state.elastic
        self.state = Particles.at_start(self.filling, self.problem.material.density)
        self.state.elastic = elastic

    def motion(self) -> tuple[Float64Array, Float64Array]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s."""
        return self.state.positions, self.state.velocities

    def frame(self, time: float) -> ParticleFrame:
        """Return copies of the state, after bounding the stretch of the rendering frames."""
        bound_stretch(self.state.deformation_gradients)
        return self.state.frame(time, self.problem)


@dataclass
class Particles:
    """The state of every particle, float64, SI.

    Attributes:
        positions: (n, 3), m.
        velocities: (n, 3), m/s.
        velocity_gradients: (n, 3, 3), the affine matrix C of APIC, 1/s.
        elastic: (n, 3, 3), elastic deformation gradient.
        volume_corrections: (n,), log of the stress-free expansion.
        plastic_strains: (n,), accumulated norm of the plastic deviatoric strain.
        deformation_gradients: (n, 3, 3), the rendering frame.
        masses: (n,), kg.
        volumes: (n,), m3 at t = 0.
        held: (n,), whether the particle has ever been held at the grid's edge.
    """

    positions: Float64Array
    velocities: Float64Array
    velocity_gradients: Float64Array
    elastic: Float64Array
    volume_corrections: Float64Array
    plastic_strains: Float64Array
    deformation_gradients: Float64Array
    masses: Float64Array
    volumes: Float64Array
    held: npt.NDArray[np.bool_]

    @classmethod
    def at_start(cls, filling: Filling, density: float) -> "Particles":
        """Return unstressed particles with the filling's velocities."""
        count = len(filling.particle_positions)
        volumes = filling.particle_volumes.astype(np.float64)
        return cls(
            positions=filling.particle_positions.astype(np.float64),
            velocities=filling.start_velocities().astype(np.float64),
            velocity_gradients=np.zeros((count, 3, 3)),
            elastic=np.tile(np.eye(3), (count, 1, 1)),
            volume_corrections=np.zeros(count),
            plastic_strains=np.zeros(count),
            deformation_gradients=np.tile(np.eye(3), (count, 1, 1)),
            masses=density * volumes,
            volumes=volumes,
            held=np.zeros(count, dtype=bool),
        )

    def frame(self, time: float, problem: SimulationProblem) -> ParticleFrame:
        """Return a copy of what the renderer needs."""
        return ParticleFrame(
            time=time,
            positions=self.positions.astype(np.float32),
            velocities=self.velocities.astype(np.float32),
            deformation_gradients=self.deformation_gradients.astype(np.float32),
            escaped=int(self.held.sum()),
            **stress_fields(self.elastic @ np.swapaxes(self.elastic, 1, 2) - np.eye(3), self.plastic_strains, problem),
        )


def advance(state: Particles, problem: SimulationProblem, contact: ContactNodes, grid: Grid, step: Step) -> None:
    """Carry the particles through one substep: scatter, grid, gather, stress."""
    time_step = step.time_step
    stencil = Stencil.around(state.positions, grid)
    momentum, impulse, mass = particles_to_grid(state, stencil, problem, grid, time_step)
    occupied = mass[:, None] > 0
    before, change = (
        np.divide(each, mass[:, None], out=np.zeros_like(each), where=occupied) for each in (momentum, impulse)
    )
    velocity = step.kept * (before + change + time_step * np.array(step.gravity))
    apply_contact(velocity.reshape(*grid.shape, 3), contact)
    apply_walls(velocity.reshape(*grid.shape, 3), problem.boundary, grid)
    grid_to_particles(state, stencil, before, velocity, problem, grid, time_step)


@dataclass
class Stencil:
    """The 27 nodes around each particle.

    Attributes:
        nodes: (n, 27), flat indices.
        weights: (n, 27), quadratic B-splines.
        arms: (n, 27, 3), node minus particle, m.
    """

    nodes: npt.NDArray[np.int64]
    weights: Float64Array
    arms: Float64Array

    @classmethod
    def around(cls, positions: Float64Array, grid: Grid) -> "Stencil":
        """Return the quadratic B-splines at positions (n, 3), m (Steffen et al. 2008)."""
        cells = (positions - np.array(grid.origin)) / grid.spacing
        first = np.floor(cells - 0.5).astype(np.int64)
        offset = cells - first
        spline = np.stack([0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1) ** 2, 0.5 * (offset - 0.5) ** 2], axis=1)
        steps = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(27, 3)
        weights = spline[:, steps[:, 0], 0] * spline[:, steps[:, 1], 1] * spline[:, steps[:, 2], 2]
        strides = np.array([grid.shape[1] * grid.shape[2], grid.shape[2], 1])
        return cls(
            nodes=(first @ strides)[:, None] + steps @ strides,
            weights=weights,
            arms=(steps[None] - offset[:, None]) * grid.spacing,
        )


def particles_to_grid(
    state: Particles, stencil: Stencil, problem: SimulationProblem, grid: Grid, time_step: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the grid's momentum (nodes, 3), the impulse of stress on it (nodes, 3), kg m/s, and its mass (nodes,), kg.

    Source: Hu et al. 2018, "A moving least squares material point method", eqs. 16 to 18; C is left out where the
    transfer isn't affine.
    """
    stress = kirchhoff_stress(state.elastic, problem.material)
    affine = problem.simulation.transfer.constants.affine * state.masses[:, None, None] * state.velocity_gradients
    carried = (state.masses[:, None] * state.velocities)[:, None] + np.einsum("pij,pnj->pni", affine, stencil.arms)
    pull = (-4 * time_step / grid.spacing**2) * state.volumes[:, None, None] * stress
    pushed = np.einsum("pij,pnj->pni", pull, stencil.arms)
    momentum, impulse = (
        np.stack([scatter(stencil.weights * each[:, :, axis], stencil, grid) for axis in range(3)], axis=1)
        for each in (carried, pushed)
    )
    return momentum, impulse, scatter(stencil.weights * state.masses[:, None], stencil, grid)


def scatter(shares: Float64Array, stencil: Stencil, grid: Grid) -> Float64Array:
    """Return the sum (nodes,) of the particles' shares (n, 27) at each node."""
    sums: Float64Array = np.bincount(stencil.nodes.ravel(), shares.ravel(), grid.node_count).astype(np.float64)
    return sums


def apply_contact(velocity: Float64Array, contact: ContactNodes) -> None:
    """Apply, in place, the solid ground to grid velocities (i, j, k, 3)."""
    nodes, normals = contact.indices()
    where = tuple(nodes.T)
    velocity[where] = _after_contact(velocity[where], normals[:, :3], normals[:, 3:])


def apply_walls(velocity: Float64Array, boundary: Boundary, grid: Grid) -> None:
    """Apply, in place, the walls to grid velocities (i, j, k, 3): on each wall's plane of nodes and all beyond."""
    pad = grid.padding
    for axis in (0, 1):
        low = [slice(None)] * 3
        low[axis] = slice(None, pad + 1)
        high = [slice(None)] * 3
        high[axis] = slice(grid.high[axis], None)
        _apply_wall(velocity[tuple(low)], axis, 1.0, boundary.sides)
        _apply_wall(velocity[tuple(high)], axis, -1.0, boundary.sides)
    _apply_wall(velocity[:, :, : pad + 1], 2, 1.0, boundary.floor)


def _apply_wall(velocity: Float64Array, axis: int, inward: float, wall: Wall) -> None:
    """Act on a block of nodes."""
    if wall.kind != "open":
        velocity[:] = _after_contact(velocity, inward * np.eye(3)[axis], np.array(wall.coefficient))


def _after_contact(velocity: Float64Array, normals: Float64Array, coefficients: Float64Array) -> Float64Array:
    """Return velocities (..., 3) after one-sided contact: no penetration, free separation, and Coulomb's friction.

    The impulse that stops the approach bounds that of friction. Coefficients (..., 1) are those of Wall.coefficient.
    """
    approach = -(velocity * normals).sum(axis=-1, keepdims=True)
    along = velocity + approach * normals
    speed = np.linalg.norm(along, axis=-1, keepdims=True)
    kept = 1 - np.divide(coefficients * approach, speed, out=np.zeros_like(speed), where=speed > 0)
    moved = np.where(approach > 0, np.clip(kept, 0, 1) * along, velocity)
    return np.where(coefficients == STICKS, 0.0, moved)


def grid_to_particles(
    state: Particles,
    stencil: Stencil,
    before: Float64Array,
    velocity: Float64Array,
    problem: SimulationProblem,
    grid: Grid,
    time_step: float,
) -> None:
    """Gather velocities, strain the particles, let them yield and move them, in place.

    `before` and `velocity` (nodes, 3), m/s, are the grid's before and after the substep's forces.
    """
    transfer = problem.simulation.transfer.constants
    # what has left the domain weighs nothing and stays where it left
    staying = (state.masses > 0)[:, None]
    shares = stencil.weights[:, :, None] * velocity[stencil.nodes]
    gathered = shares.sum(axis=1)
    excess = state.velocities - (stencil.weights[:, :, None] * before[stencil.nodes]).sum(axis=1)
    state.velocities = staying * (gathered + transfer.velocity_share * excess)
    state.velocity_gradients = staying[:, None] * (
        (4 / grid.spacing**2) * np.einsum("pni,pnj->pij", shares, stencil.arms)
    )
    # only what bore no pressure may move against its neighbours (Fei et al. 2021)
    loose = np.log(np.linalg.det(state.elastic)) >= LOOSE_STRAIN
    change = np.eye(3) + time_step * state.velocity_gradients
    state.deformation_gradients = change @ state.deformation_gradients
    flow = return_mapping(change @ state.elastic, state.volume_corrections, problem.material)
    state.elastic, state.volume_corrections = flow.elastic, flow.volume_correction
    state.plastic_strains = state.plastic_strains + flow.sheared
    ways = gathered + transfer.position_share * loose[:, None] * excess
    carry(state, time_step * staying * ways, problem, grid)


def carry(state: Particles, ways: Float64Array, problem: SimulationProblem, grid: Grid) -> None:
    """Move the particles by `ways` (n, 3), m, in place; what leaves the domain weighs nothing from then on."""
    moved = state.positions + ways
    low, high = (np.array(grid.origin) + grid.spacing * np.array(limit) for limit in problem.limits(grid))
    state.positions = np.clip(moved, low, high)
    leaving = ((moved < low) | (moved > high)).any(axis=1)
    state.held |= leaving
    for quantity in (state.masses, state.volumes, state.velocities, state.velocity_gradients):
        quantity[leaving] = 0


def bound_stretch(deformation_gradients: Float64Array) -> None:
    """Hold, in place, the principal stretches of the rendering frames (n, 3, 3) between the renderer's bounds."""
    low, high = STRETCH_BOUNDS
    left, stretches, right = np.linalg.svd(deformation_gradients)
    outside = ((stretches < low) | (stretches > high)).any(axis=1)
    bounded = np.clip(stretches[outside], low, high)
    deformation_gradients[outside] = (left[outside] * bounded[:, None, :]) @ right[outside]
