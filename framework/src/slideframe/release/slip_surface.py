"""The slip surface of each kind of base, on a grid over the plan."""

from collections.abc import Callable

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Region
from slideframe.release.grid import ReleaseGrid
from slideframe.release.plan import Plan

GroundHeights = Callable[[Float64Array, Float64Array], Float64Array]

LEAST_CELLS = 100  # along the plan's longer side
MOST_NODES = 1_000_000


def release_grid(region: Region, plan: Plan, ground: GroundHeights, spacing: float) -> ReleaseGrid:
    """Work the slip surface out on a grid of about `spacing` metres.

    Args:
        region: whose base is meant.
        plan: its area.
        ground: returns the highest ground at (x, y), minus infinity where there is none, m.
        spacing: of nodes, m; finer for a small plan, coarser for a vast one.
    """
    x, y = _axes(plan.bounds, spacing)
    across, along = np.meshgrid(x, y, indexing="ij")
    heights = ground(across.ravel(), along.ravel()).reshape(across.shape).astype(np.float64)
    return ReleaseGrid(x, y, heights, np.full(across.shape, float(region.z_min)))


def _axes(bounds: Float64Array, spacing: float) -> list[Float64Array]:
    """Return evenly spaced nodes that reach one cell over the bounds on every side."""
    sides = bounds[1] - bounds[0]
    spacing = max(min(spacing, float(sides.max()) / LEAST_CELLS), float(np.sqrt(np.prod(sides) / MOST_NODES)))
    axes = []
    for low, high in bounds.T:
        cells = max(int(np.ceil((high - low) / spacing)), 1)
        step = (high - low) / cells
        axes.append(low + step * np.arange(-1, cells + 2))
    return axes
