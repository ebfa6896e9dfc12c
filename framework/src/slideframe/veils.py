"""Which splats lie hidden at t = 0, and the particle whose leaving bares each of them."""

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array

NO_PARTICLE = -1


def particles_over(points: Float32Array, particles: Float32Array, spacing: float) -> npt.NDArray[np.int64]:
    """Return the particle (n,) nearest to each point (n, 3), or NO_PARTICLE where none is in the columns about it.

    Columns are upright, `spacing` m wide; a point's own and the eight around it are searched, and in each
    the particles next above and below. That is enough for points on the border of the filled ground.
    """
    found = np.full(len(points), NO_PARTICLE, np.int64)
    if not len(points) or not len(particles):
        return found
    low = np.minimum(points.min(axis=0), particles.min(axis=0)).astype(np.float64)
    high = np.maximum(points.max(axis=0), particles.max(axis=0)).astype(np.float64)
    row, height = int((high[1] - low[1]) / spacing) + 4, float(high[2] - low[2]) + 1.0
    ranks = _columns(particles - low, spacing) @ [row, 1] * height + (particles[:, 2] - low[2])
    order = np.argsort(ranks, kind="stable")
    ranks = ranks[order]
    nearest = np.full(len(points), np.inf)
    for step in np.ndindex(3, 3):
        column = (_columns(points - low, spacing) + step - 1) @ [row, 1]
        place = np.searchsorted(ranks, column * height + (points[:, 2] - low[2]))
        for candidate in (place - 1, place):
            inside = candidate.clip(0, len(ranks) - 1)
            distance = np.linalg.norm(points - particles[order[inside]], axis=1)
            better = (np.floor(ranks[inside] / height) == column) & (distance < nearest)
            nearest[better], found[better] = distance[better], order[inside[better]]
    return found


def _columns(places: Float64Array, spacing: float) -> npt.NDArray[np.int64]:
    """Return the column (n, 2) of each place, none of them on the border, so that neighbours exist."""
    return (places[:, :2] / spacing).astype(np.int64) + 1
