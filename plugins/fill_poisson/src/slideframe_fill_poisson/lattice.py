"""Particles on a lattice that fits the region exactly, their volumes adding up to the soil's."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.problem import BoxRegion
from slideframe_fill_poisson.surface import Crossings, Surface

MOST_LINES = 4_000_000  # lines that measure the volume, for memory's sake


@dataclass(frozen=True)
class Lattice:
    """Vertical columns of cells over the region's plan. The sides of a cell are within half a cell's share of
    `spacing`, so that whole cells fit; its height is `spacing` exactly.
    """

    region: BoxRegion
    spacing: float

    @property
    def shape(self) -> tuple[int, int]:
        """Columns along x and along y."""
        return (
            max(round((self.region.x_max - self.region.x_min) / self.spacing), 1),
            max(round((self.region.y_max - self.region.y_min) / self.spacing), 1),
        )

    @property
    def cell_area(self) -> float:
        """Plan area of a column, m2."""
        region, (east, north) = self.region, self.shape
        return (region.x_max - region.x_min) * (region.y_max - region.y_min) / (east * north)

    def columns(self, refinement: int = 1) -> tuple[Float64Array, Float64Array]:
        """Return x and y of the middle of every column (column,), each divided `refinement` times per side."""
        region, (east, north) = self.region, self.shape
        x = _middles(region.x_min, region.x_max, east * refinement)
        y = _middles(region.y_min, region.y_max, north * refinement)
        across, along = np.meshgrid(x, y, indexing="ij")
        return across.ravel(), along.ravel()


def measure_volume(surface: Surface, lattice: Lattice) -> float:
    """Return the soil's volume by columns narrower than the lattice's where the plan isn't vast, m3."""
    refinement = int(np.clip(np.sqrt(MOST_LINES / np.prod(lattice.shape)), 1, 3))
    soil = surface.soil(*lattice.columns(refinement), lattice.region.z_min)
    lengths = soil.tops.astype(np.float64) - soil.bottoms
    return float(lengths.sum() * lattice.cell_area / refinement**2)


def place_particles(soil: Crossings, lattice: Lattice) -> tuple[Float32Array, Float32Array]:
    """Return positions (particle, 3), m, and volumes (particle,), m3, for the soil of the lattice's columns.

    Particles stand in the lattice's cells and have their volume. The first and the last of a stretch take
    what is cut off, half a cell to one and a half, at their centroid; the only particle of a thin stretch
    takes all of it, less than two cells. A stretch of less than half a cell that misses every centre
    stays empty.
    """
    spacing, base = lattice.spacing, lattice.region.z_min
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


def _middles(low: float, high: float, count: int) -> Float64Array:
    return low + (high - low) * (np.arange(count) + 0.5) / count
