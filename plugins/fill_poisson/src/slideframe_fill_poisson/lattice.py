"""Particles in a body, on a lattice that fits the body's plan, their volumes adding up to the body's."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe_fill_poisson.rays import Crossings


@dataclass(frozen=True)
class Lattice:
    """Vertical columns of cells over a rectangle. The sides of a cell are within half a cell's share of
    `spacing`, so that whole cells fit; its height is `spacing` exactly.

    Attributes:
        bounds: lowest and highest corner of the body (2, 3), m; cells stand on the lowest.
        spacing: of particles, m.
    """

    bounds: Float64Array
    spacing: float

    @property
    def shape(self) -> tuple[int, int]:
        """Columns along x and along y."""
        east, north = (max(round(float(side) / self.spacing), 1) for side in self._sides)
        return east, north

    @property
    def cell_area(self) -> float:
        """Plan area of a column, m2."""
        return float(np.prod(self._sides) / np.prod(self.shape))

    def columns(self) -> tuple[Float64Array, Float64Array]:
        """Return x and y of the middle of every column (column,)."""
        axes = [
            low + (high - low) * (np.arange(count) + 0.5) / count
            for low, high, count in zip(self.bounds[0], self.bounds[1], self.shape, strict=False)
        ]
        across, along = np.meshgrid(*axes, indexing="ij")
        return across.ravel(), along.ravel()

    @property
    def _sides(self) -> Float64Array:
        sides: Float64Array = self.bounds[1, :2] - self.bounds[0, :2]
        return sides


def place_particles(soil: Crossings, lattice: Lattice) -> tuple[Float32Array, Float32Array]:
    """Return positions (particle, 3), m, and volumes (particle,), m3, for the soil of the lattice's columns.

    Particles stand in the lattice's cells and have their volume. The first and the last of a stretch take
    what is cut off, half a cell to one and a half, at their centroid; the only particle of a thin stretch
    takes all of it, less than two cells. A stretch of less than half a cell that misses every centre
    stays empty.
    """
    spacing, base = lattice.spacing, float(lattice.bounds[0, 2])
    first = np.floor((soil.bottoms - base) / spacing + 0.5).astype(np.int64)
    last = np.ceil((soil.tops - base) / spacing - 0.5).astype(np.int64) - 1
    lengths = soil.tops - soil.bottoms
    thin = (last < first) & (lengths >= 0.5 * spacing)
    last = np.where(thin, first, last)
    counts = np.maximum(last - first + 1, 0)
    stretch = np.repeat(np.arange(len(counts)), counts)
    level = first[stretch] + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    low = np.where(level == first[stretch], soil.bottoms[stretch], base + level * spacing)
    high = np.where(level == last[stretch], soil.tops[stretch], base + (level + 1) * spacing)
    x, y = lattice.columns()
    line = soil.lines[stretch]
    positions = np.column_stack([x[line], y[line], (low + high) / 2]).astype(np.float32)
    return positions, (lattice.cell_area * (high - low)).astype(np.float32)
