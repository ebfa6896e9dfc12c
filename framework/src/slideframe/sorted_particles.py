"""The particles of solvers on a sparse grid: arrays by name in a backend's memory, in the order of their cells."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.problem import Grid, Simulation, SimulationProblem
from slideframe.products import Filling

Shape = tuple[int, ...]

SHAPES: dict[str, Shape] = {
    "positions": (3,),
    "residuals": (3,),
    "velocities": (3,),
    "affines": (3, 3),
    "elastic_states": (6,),
    "volume_corrections": (),
    "deformation_gradients": (3, 3),
    "masses": (),
    "volumes": (),
}


def shapes(simulation: Simulation) -> dict[str, Shape]:
    """Return the arrays of reals that a simulation keeps: stress terms and plastic strain only where it needs them."""
    pulls: dict[str, Shape] = {} if simulation.transfer.constants.is_plain else {"pulls": (3, 3)}
    strains: dict[str, Shape] = {"plastic_strains": ()} if simulation.record_stress else {}
    return SHAPES | pulls | strains


def reals_per_particle(simulation: Simulation) -> int:
    """Return how many reals a particle takes; while sorting there is one more array of each shape."""
    kept = shapes(simulation).values()
    return sum(map(prod, kept)) + sum(map(prod, set(kept)))


class SortedParticles(ABC):
    """Arrays of particles by name; `identities` leads back to the filling's order."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid) -> None:
        """Lay out the particles at t = 0, without stress."""
        self.count = len(filling.particle_positions)
        self.precision = np.dtype(problem.simulation.precision)
        self._forms: dict[str, tuple[Shape, np.dtype[Any]]] = {
            name: (shape, self.precision) for name, shape in shapes(problem.simulation).items()
        }
        self._forms |= {name: ((), np.dtype(np.int32)) for name in ("held", "identities")}
        self._arrays = {name: self._allocate(*form) for name, form in self._forms.items()}
        for name, values in _start(filling, problem, grid):
            self._write(self._arrays[name], values.astype(self._forms[name][1]))
        self._spares: dict[tuple[Shape, np.dtype[Any]], Any] = {}

    @abstractmethod
    def _allocate(self, shape: Shape, kind: np.dtype[Any]) -> Any:
        """Return zeros (count, *shape)."""

    @abstractmethod
    def _write(self, array: Any, values: npt.NDArray[Any]) -> None:
        """Copy values (count, ...) of an array's own type into it."""

    @abstractmethod
    def _read(self, array: Any) -> npt.NDArray[Any]:
        """Return an array's values, which may be its own memory."""

    def __getitem__(self, name: str) -> Any:
        """Give an array; stress terms that needn't be apart are with the affines."""
        return self._arrays["affines" if name == "pulls" and name not in self._arrays else name]

    def names(self) -> list[str]:
        """Return the names of all arrays."""
        return list(self._arrays)

    def swap(self, name: str) -> tuple[Any, Any]:
        """Return an array and a spare one of its form that takes its place; the old one is the next spare."""
        form, array = self._forms[name], self._arrays[name]
        spare = self._spares.pop(form, None)
        if spare is None:
            spare = self._allocate(*form)
        self._spares[form], self._arrays[name] = array, spare
        return array, spare

    def assign(self, name: str, values: npt.NDArray[np.floating]) -> None:
        """Take values in the filling's order as one of the arrays of reals."""
        order = self._read(self._arrays["identities"])
        self._write(self._arrays[name], values[order].astype(self.precision))

    def in_order(self, *names: str) -> list[npt.NDArray[Any]]:
        """Return copies of arrays, in the filling's order."""
        order = self._read(self._arrays["identities"])
        places = np.empty_like(order)
        places[order] = np.arange(self.count, dtype=order.dtype)
        return [np.take(self._read(self._arrays[name]), places, axis=0) for name in names]

    def escaped(self) -> int:
        """Return how many particles have left the domain."""
        return int(np.count_nonzero(self._read(self._arrays["held"])))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all arrays, in their present order."""
        return {name: np.array(self._read(array)) for name, array in self._arrays.items()}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take over all arrays, their order included."""
        for name, array in self._arrays.items():
            self._write(array, np.array(state[name]))


def _start(filling: Filling, problem: SimulationProblem, grid: Grid) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield what isn't zero at t = 0, one after another, since together it's large."""
    yield "positions", (filling.particle_positions.astype(np.float64) - np.array(grid.origin)) / grid.spacing
    yield "velocities", filling.start_velocities()
    count, volumes = len(filling.particle_volumes), filling.particle_volumes.astype(np.float64)
    yield "deformation_gradients", np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
    yield "masses", problem.material.density * volumes
    yield "volumes", volumes
    yield "identities", np.arange(count)
