"""What steppers of solvers on a sparse grid share: their state, kept and given back, and the frames they hand out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.initial_stress import elastic_state
from slideframe.problem import Grid, SimulationProblem
from slideframe.products import Filling, ParticleFrame
from slideframe.sorted_particles import SortedParticles
from slideframe.stress import stress_fields, symmetric
from slideframe.time_integration import Step


class SparseStepper(ABC):
    """One simulation's particles, which a subclass places and moves.

    Attributes:
        drift: a bound on how far, in cells, a particle has moved since the grid was laid; there is none at first.
    """

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid) -> None:
        """Lay out the particles at t = 0, without stress."""
        self.filling, self.problem, self.grid = filling, problem, grid
        self.restart_particles()

    def restart_particles(self) -> None:
        """Place the particles where they are at t = 0."""
        self.particles = self._place_particles()
        self.step, self.drift = Step(0.0, self.problem.simulation.gravity), np.inf

    @abstractmethod
    def _place_particles(self) -> SortedParticles:
        """Return the particles at t = 0."""

    @abstractmethod
    def _bound_stretch(self) -> None:
        """Hold the stretches of the rendering frames within STRETCH_BOUNDS."""

    def load(self, hencky: Float64Array) -> None:
        """Take elastic Hencky strains (n, 3, 3) in the order of the filling as the state."""
        self.particles.assign("elastic_states", elastic_state(hencky))

    def restart(self) -> None:
        """Put the particles back where they were at t = 0 and keep their stress."""
        (states,) = self.particles.in_order("elastic_states")
        self.restart_particles()
        self.particles.assign("elastic_states", states)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next substep depends on; from here on a stepper with that state has the same bits."""
        self.drift = np.inf  # both lay the grid anew
        return self.particles.state() | {"time_step": np.array(self.step.time_step)}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from a state."""
        self.particles.restore(state)
        self.step, self.drift = Step(float(state["time_step"]), self.step.gravity), np.inf

    def motion(self) -> tuple[Float64Array, npt.NDArray[np.floating]]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s, in the order of the filling."""
        cells, velocities = self.particles.in_order("positions", "velocities")
        return cells.astype(np.float64) * self.grid.spacing + np.array(self.grid.origin), velocities

    def frame(self, time: float) -> ParticleFrame:
        """Return copies of the state, after bounding the stretch of the rendering frames."""
        self._bound_stretch()
        positions, velocities = self.motion()
        (gradients,) = self.particles.in_order("deformation_gradients")
        return ParticleFrame(
            time=time,
            positions=positions.astype(np.float32),
            velocities=velocities.astype(np.float32, copy=False),
            deformation_gradients=gradients.astype(np.float32, copy=False),
            escaped=self.particles.escaped(),
            **self._stress_fields(),
        )

    def _stress_fields(self) -> dict[str, Any]:
        if not self.problem.simulation.record_stress:
            return {}
        states, strains = self.particles.in_order("elastic_states", "plastic_strains")
        return stress_fields(symmetric(states), strains, self.problem)
