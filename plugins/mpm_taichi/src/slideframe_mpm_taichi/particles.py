"""The particles in Taichi's memory, which sorting moves about."""

from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.sorted_particles import Shape, SortedParticles


class Particles(SortedParticles):
    """Arrays of particles by name, in the order of their cells."""

    def _allocate(self, shape: Shape, kind: np.dtype[Any]) -> Any:
        """Return zeros (count, *shape)."""
        import taichi as ti

        number = {"int32": ti.i32, "float32": ti.f32, "float64": ti.f64}[kind.name]
        elements = {(): lambda: number, (3, 3): lambda: ti.types.matrix(3, 3, number)}
        array = ti.ndarray(elements.get(shape, lambda: ti.types.vector(shape[0], number))(), self.count)
        array.fill(0)
        return array

    def _write(self, array: Any, values: npt.NDArray[Any]) -> None:
        """Copy values (count, ...) of an array's own type into it."""
        array.from_numpy(values)

    def _read(self, array: Any) -> npt.NDArray[Any]:
        """Return a copy of an array's values."""
        values: npt.NDArray[Any] = array.to_numpy()
        return values

    def __getitem__(self, name: str) -> Any:
        """Give an array; plastic strains that aren't recorded are unused."""
        return super().__getitem__("volumes" if name == "plastic_strains" and name not in self._arrays else name)
