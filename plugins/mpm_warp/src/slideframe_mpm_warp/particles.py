"""The particles in Warp's memory, which sorting moves about."""

from collections.abc import Mapping
from types import ModuleType
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
# held, identities, one more while sorting, and sort keys and places with their spare halves
INTEGERS_PER_PARTICLE = 1 + 1 + 1 + 2 * 2


class Particles:
    """Arrays of particles by name, in the order of their cells; `identities` leads back to the filling's order."""

    def __init__(
        self, filling: Filling, problem: SimulationProblem, grid: Grid, kernels: ModuleType, device: str
    ) -> None:
        """Lay out the particles at t = 0, without stress."""
        import warp as wp

        self.count = len(filling.particle_positions)
        real = np.dtype(kernels.Real.__name__)
        cells = (filling.particle_positions.astype(np.float64) - np.array(grid.origin)) / grid.spacing
        volumes = filling.particle_volumes.astype(np.float64)
        start: dict[str, tuple[Any, npt.NDArray[Any] | None]] = {
            "positions": (kernels.Vector, cells),
            "residuals": (kernels.Vector, None),
            "velocities": (kernels.Vector, filling.start_velocities()),
            "affines": (kernels.Matrix, None),
            "elastic_states": (kernels.Vector6, None),
            "volume_corrections": (kernels.Real, None),
            "deformation_gradients": (kernels.Matrix, np.tile(np.eye(3, dtype=real), (self.count, 1, 1))),
            "masses": (kernels.Real, problem.material.density * volumes),
            "volumes": (kernels.Real, volumes),
            "held": (int, None),
            "identities": (int, np.arange(self.count)),
        }
        if not problem.simulation.transfer.constants.is_plain:
            start["pulls"] = (kernels.Matrix, None)
        if problem.simulation.record_stress:
            start["plastic_strains"] = (kernels.Real, None)
        self._arrays: dict[str, Any] = {}
        with wp.ScopedDevice(device):
            for name, (element, values) in start.items():
                array = wp.zeros(self.count, dtype=element)
                if values is not None:
                    array.assign(values.astype(np.int32 if element is int else real))
                self._arrays[name] = array
            self._none = wp.zeros(0, dtype=kernels.Real)
        self._spares: dict[Any, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """Give an array; stress terms that needn't be apart are with the affines, plastic strains may be none."""
        if name == "pulls":
            return self._arrays.get(name, self._arrays["affines"])
        return self._none if name == "plastic_strains" and name not in self._arrays else self._arrays[name]

    def assign(self, name: str, values: npt.NDArray[np.floating]) -> None:
        """Take values in the filling's order as one of the arrays of reals."""
        array = self._arrays[name]
        ordered = values[self._arrays["identities"].numpy()]
        array.assign(ordered.astype(array.numpy().dtype))

    def swap(self, name: str) -> tuple[Any, Any]:
        """Return an array and a spare one of its type that takes its place; the old one is the next spare."""
        import warp as wp

        array = self._arrays[name]
        spare = self._spares.pop(array.dtype, None)
        if spare is None:
            spare = wp.empty_like(array)
        self._spares[array.dtype], self._arrays[name] = array, spare
        return array, spare

    def names(self) -> list[str]:
        """Return the names of all arrays."""
        return list(self._arrays)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all arrays, in their present order."""
        return {name: array.numpy().copy() for name, array in self._arrays.items()}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take over all arrays, their order included."""
        for name, array in self._arrays.items():
            array.assign(state[name])

    def in_order(self, name: str) -> npt.NDArray[Any]:
        """Return a copy of one array, in the filling's order."""
        values: npt.NDArray[Any] = self[name].numpy()
        ordered = np.empty_like(values)
        if len(values):
            ordered[self._arrays["identities"].numpy()] = values
        return ordered
