"""The test rig: one solver, driven through the public interface."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.device import Device
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context, FigureValue, Solver


@dataclass(frozen=True)
class Motion:
    """What a solver made of a problem.

    Attributes:
        filling: the start.
        problem: the problem.
        frames: one for each output time, the first at t = 0.
        figures: what the solver reported.
    """

    filling: Filling
    problem: SimulationProblem
    frames: list[ParticleFrame]
    figures: Mapping[str, FigureValue]

    @cached_property
    def times(self) -> Float64Array:
        """Output times (frame,), s."""
        return np.array([frame.time for frame in self.frames])

    @cached_property
    def positions(self) -> Float64Array:
        """Positions (frame, particle, 3), m."""
        return np.stack([frame.positions.astype(np.float64) for frame in self.frames])

    @cached_property
    def velocities(self) -> Float64Array:
        """Velocities (frame, particle, 3), m/s."""
        return np.stack([frame.velocities.astype(np.float64) for frame in self.frames])

    @cached_property
    def masses(self) -> Float64Array:
        """Masses (particle,), kg."""
        return self.problem.material.density * self.filling.particle_volumes.astype(np.float64)

    def mean(self, values: Float64Array) -> Float64Array:
        """Return the mean over the mass of values (frame, particle, ...)."""
        mean: Float64Array = np.average(values, axis=1, weights=self.masses)
        return mean

    def kinetic_energy(self) -> Float64Array:
        """Return the energy of the particles' own velocities (frame,), J."""
        energy: Float64Array = 0.5 * (self.velocities**2).sum(axis=2) @ self.masses
        return energy


@dataclass(frozen=True)
class Rig:
    """Runs one solver; a problem that was solved before is not solved again."""

    solver: Solver
    device: Device = field(default_factory=Device)
    _solved: dict[tuple[str, bytes], Motion] = field(default_factory=dict)

    def run(self, filling: Filling, problem: SimulationProblem) -> Motion:
        """Solve a problem to its end."""
        arrays = [getattr(filling, name).tobytes() for name in filling.array_fields()]
        key = problem.model_dump_json(), b"".join(arrays)
        if key not in self._solved:
            self.solver.preflight(problem, self.device)
            with tempfile.TemporaryDirectory(prefix="slideframe-verify-") as scratch:
                context = Context(self.device, Path(scratch))
                frames = list(self.solver.solve(filling, problem, context))
            self._solved[key] = Motion(filling, problem, frames, context.figures)
        return self._solved[key]
