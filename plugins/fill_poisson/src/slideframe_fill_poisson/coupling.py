"""Which observed splats move with the soil, and on which particle each rides."""

from typing import Literal

import numpy as np

from slideframe.arrays import Float32Array, Int32Array
from slideframe.products import SplatCloud
from slideframe.release.grid import ReleaseGrid
from slideframe.release.plan import Plan
from slideframe_fill_poisson.surface import Surface

STAYS = -1
# The nearest particle of a splat on the soil is within the diagonal of its cell, 1.7 spacings.
REACH_SPACINGS = 2.0

Standing = Literal["move", "stay"]


def carriers(
    splats: SplatCloud,
    positions: Float32Array,
    surface: Surface,
    plan: Plan,
    grid: ReleaseGrid,
    spacing: float,
    standing_height: float,
) -> Int32Array:
    """Return for every splat the particle that it follows, or STAYS (splat,).

    Splats move above the slip surface inside the region's plan, up to `standing_height` metres over the ground
    (plants, loose things), where soil is near: over bare slip surface there is nothing to ride on.
    """
    from scipy.spatial import cKDTree

    found = np.full(len(splats), STAYS, np.int32)
    inside = np.flatnonzero(plan.contains(splats.centers[:, 0], splats.centers[:, 1]))
    centers = splats.centers[inside]
    base = grid.base_at(centers[:, 0], centers[:, 1])
    ground = surface.top(centers[:, 0].astype(np.float64), centers[:, 1].astype(np.float64))
    over = centers[:, 2] - ground
    # what stands on a slope leans on the soil right below it, so the search starts at its foot
    foot = np.column_stack([centers[:, :2], np.minimum(centers[:, 2], ground)])
    moves = np.isfinite(ground) & (over <= standing_height) & ~(centers[:, 2] <= base)
    chosen = np.flatnonzero(moves)
    distance, particle = cKDTree(positions).query(foot[chosen], workers=-1)
    near = distance <= REACH_SPACINGS * spacing
    found[inside[chosen[near]]] = particle[near]
    return found
