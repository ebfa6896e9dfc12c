"""Small starts for solvers: lattices of particles in a box."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Filling, SplatCloud

Corner = Sequence[float]


def lattice(low: Corner, high: Corner, counts: Sequence[int]) -> tuple[Float64Array, float]:
    """Return the centres (n, 3), m, of a block cut into equal pieces, and the volume of one, m3."""
    edges = [(end - start) / count for start, end, count in zip(low, high, counts, strict=True)]
    axes = [start + edge * (np.arange(count) + 0.5) for start, edge, count in zip(low, edges, counts, strict=True)]
    points: Float64Array = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, float(np.prod(edges))


def filling(
    positions: npt.NDArray[np.floating], particle_volume: float, box: tuple[Corner, Corner], **more: Float32Array
) -> Filling:
    """Return particles (n, 3), m, of equal volume without splats in a box given by its lowest and highest corner."""
    return Filling(
        bounds=np.array(box, np.float64),
        particle_positions=positions.astype(np.float32),
        particle_volumes=np.full(len(positions), particle_volume, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.zeros(0, np.int32),
        surface_particles=np.zeros(0, np.int32),
        surface_vertices=np.zeros((0, 3), np.float32),
        surface_triangles=np.zeros((0, 3), np.int32),
        surface_support=np.zeros(0, np.uint8),
        **more,
    )


def column(height: float, cells: int) -> Filling:
    """Return a column in a box that it fills: two cells by two across, two particles in each."""
    spacing = height / cells
    positions, volume = lattice((0, 0, 0), (2 * spacing, 2 * spacing, height), (2, 2, 2 * cells))
    return filling(positions, volume, ((0, 0, 0), (2 * spacing, 2 * spacing, height)))


def slice_of(
    low: tuple[float, float], high: tuple[float, float], spacing: float, length: float, height: float = 0.0
) -> Filling:
    """Return a rectangle in the x-z plane, m, two cells thick between slip walls: plane strain.

    Eight particles fill a cell by two by two layers in the plane; across it, each of the two cells has one.

    Args:
        low: x and z of the lower corner.
        high: x and z of the upper corner.
        spacing: of the grid.
        length: of the box, from x = 0.
        height: of the box; by default that of the rectangle.
    """
    counts = [round(2 * (end - start) / spacing) for start, end in zip(low, high, strict=True)]
    positions, volume = lattice((low[0], 0, low[1]), (high[0], 2 * spacing, high[1]), (counts[0], 2, counts[1]))
    return filling(positions, volume, ((0, 0, 0), (length, 2 * spacing, max(height, high[1]))))
