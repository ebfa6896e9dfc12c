"""The particles in Taichi's memory, which sorting moves about."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.problem import Grid, SimulationProblem
from slideframe.products import Filling

# positions, residuals, velocities, affines, elastic states, volume corrections, deformation gradients, masses, volumes,
# and while sorting one more matrix, vector, state and scalar
REALS_PER_PARTICLE = 3 + 3 + 3 + 9 + 6 + 1 + 9 + 1 + 1 + (9 + 3 + 6 + 1)
# in addition the stress terms where a transfer keeps them apart, and plastic strain where it is recorded
REALS_PER_PULL, REALS_PER_PLASTIC_STRAIN = 9, 1
# held, identities, one more while sorting, and sort keys and places
INTEGERS_PER_PARTICLE = 1 + 1 + 1 + 1 + 1


class Particles:
    """Arrays of particles by name, in the order of their cells; `identities` leads back to the filling's order."""

    def __init__(self, filling: Filling, problem: SimulationProblem, grid: Grid) -> None:
        """Lay out the particles at t = 0, without stress."""
        import taichi as ti

        self.count = len(filling.particle_positions)
        precision = problem.simulation.precision
        real = ti.f64 if precision == "float64" else ti.f32
        vector, matrix, state = ti.types.vector(3, real), ti.types.matrix(3, 3, real), ti.types.vector(6, real)
        cells = (filling.particle_positions.astype(np.float64) - np.array(grid.origin)) / grid.spacing
        volumes = filling.particle_volumes.astype(np.float64)
        start: dict[str, tuple[Any, npt.NDArray[Any] | None]] = {
            "positions": (vector, cells),
            "residuals": (vector, None),
            "velocities": (vector, filling.start_velocities()),
            "affines": (matrix, None),
            "elastic_states": (state, None),
            "volume_corrections": (real, None),
            "deformation_gradients": (matrix, np.tile(np.eye(3), (self.count, 1, 1))),
            "masses": (real, problem.material.density * volumes),
            "volumes": (real, volumes),
            "held": (ti.i32, None),
            "identities": (ti.i32, np.arange(self.count)),
        }
        if not problem.simulation.transfer.constants.is_plain:
            start["pulls"] = (matrix, None)
        if problem.simulation.record_stress:
            start["plastic_strains"] = (real, None)
        self._arrays: dict[str, Any] = {}
        self._elements = {name: element for name, (element, _) in start.items()}
        for name, (element, values) in start.items():
            self._arrays[name] = ti.ndarray(element, self.count)
            if values is None:
                self._arrays[name].fill(0)
            else:
                self._arrays[name].from_numpy(values.astype(np.int32 if element is ti.i32 else precision))
        self._spares: dict[int, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """Give an array; stress terms that needn't be apart are with the affines, plastic strains are then unused."""
        stand_ins = {"pulls": "affines", "plastic_strains": "volumes"}
        return self._arrays[name if name in self._arrays else stand_ins[name]]

    def assign(self, name: str, values: npt.NDArray[np.floating]) -> None:
        """Take values in the filling's order as one of the arrays of reals."""
        array = self._arrays[name]
        ordered = values[self._arrays["identities"].to_numpy()]
        array.from_numpy(ordered.astype(array.to_numpy().dtype))

    def swap(self, name: str) -> tuple[Any, Any]:
        """Return an array and a spare one of its type that takes its place; the old one is the next spare."""
        import taichi as ti

        element, array = self._elements[name], self._arrays[name]
        spare = self._spares.pop(id(element), None)
        if spare is None:
            spare = ti.ndarray(element, self.count)
        self._spares[id(element)], self._arrays[name] = array, spare
        return array, spare

    def names(self) -> list[str]:
        """Return the names of all arrays."""
        return list(self._arrays)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all arrays, in their present order."""
        return {name: array.to_numpy() for name, array in self._arrays.items()}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take over all arrays, their order included."""
        for name, array in self._arrays.items():
            array.from_numpy(np.array(state[name]))

    def in_order(self, name: str) -> npt.NDArray[Any]:
        """Return a copy of one array, in the filling's order."""
        values: npt.NDArray[Any] = self[name].to_numpy()
        ordered = np.empty_like(values)
        ordered[self._arrays["identities"].to_numpy()] = values
        return ordered
