"""Which observed splats move with the soil, and on which particle each rides."""

import numpy as np

from slideframe.arrays import Float32Array, Int32Array
from slideframe.problem import BoxRegion
from slideframe.products import SplatCloud
from slideframe_fill_poisson.support import around
from slideframe_fill_poisson.surface import Surface

STAYS = -1
# The nearest particle of a splat on the soil is within the diagonal of its cell, 1.7 spacings.
REACH_SPACINGS = 2.0


def carriers(
    splats: SplatCloud,
    positions: Float32Array,
    surface: Surface,
    region: BoxRegion,
    spacing: float,
    standing_height: float,
) -> Int32Array:
    """Return for every splat the particle that it follows, or STAYS (splat,).

    Splats move above the base inside the region's plan, up to `standing_height` metres over the surface
    (plants, loose things), where soil is near: over bare base there is nothing to ride on.
    """
    from scipy.spatial import cKDTree

    found = np.full(len(splats), STAYS, np.int32)
    inside = np.flatnonzero(around(splats.centers, region, 0.0) & (splats.centers[:, 2] > region.z_min))
    centers = splats.centers[inside]
    ground = surface.top(centers[:, 0].astype(np.float64), centers[:, 1].astype(np.float64))
    over = centers[:, 2] - ground
    # what stands on a slope leans on the soil right below it, so the search starts at its foot
    foot = np.column_stack([centers[:, :2], np.minimum(centers[:, 2], ground)])
    chosen = np.flatnonzero(np.isfinite(ground) & (over <= standing_height))
    distance, particle = cKDTree(positions).query(foot[chosen])
    near = distance <= REACH_SPACINGS * spacing
    found[inside[chosen[near]]] = particle[near]
    return found
