"""The particles in Warp's memory, which sorting moves about."""

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.problem import Grid, SimulationProblem
from slideframe.products import Filling
from slideframe.sorted_particles import Shape, SortedParticles


class Particles(SortedParticles):
    """Arrays of particles by name, in the order of their cells."""

    def __init__(
        self, filling: Filling, problem: SimulationProblem, grid: Grid, kernels: ModuleType, device: str
    ) -> None:
        """Lay out the particles at t = 0, without stress."""
        import warp as wp

        self._elements = {(): kernels.Real, (3,): kernels.Vector, (6,): kernels.Vector6, (3, 3): kernels.Matrix}
        self._device = device
        self._none = wp.zeros(0, dtype=kernels.Real, device=device)
        super().__init__(filling, problem, grid)

    def _allocate(self, shape: Shape, kind: np.dtype[Any]) -> Any:
        """Return zeros (count, *shape)."""
        import warp as wp

        element = wp.int32 if kind == np.int32 else self._elements[shape]
        return wp.zeros(self.count, dtype=element, device=self._device)

    def _write(self, array: Any, values: npt.NDArray[Any]) -> None:
        """Copy values (count, ...) of an array's own type into it."""
        array.assign(values)

    def _read(self, array: Any) -> npt.NDArray[Any]:
        """Return an array's values, on the CPU its own memory."""
        values: npt.NDArray[Any] = array.numpy()
        return values

    def __getitem__(self, name: str) -> Any:
        """Give an array; plastic strains that aren't recorded are none."""
        return self._none if name == "plastic_strains" and name not in self._arrays else super().__getitem__(name)
