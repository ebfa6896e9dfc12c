"""Tells what stands on the ground (trees, poles, narrow walls) from the ground."""

import numpy as np

from slideframe.arrays import Float64Array

CELL_SPACINGS = 1.5  # side of a cell in splat spacings: most cells of ground hold two splats
MOST_CELLS = 24  # across the widest thing
# Ground between two windows may rise as steeply as this (60 degrees); what rises more isn't ground.
STEEPEST = 1.75
LEAST_RISE = 0.5  # m; lower plants are part of the ground's roughness


def standing_splats(centers: Float64Array, spacing: float, width: float) -> np.ndarray:
    """Tell which splats belong to things narrower than `width` metres that rise abruptly from the ground (splat,).

    The progressive morphological filter of Zhang et al. 2003 on the highest splat of each cell: openings by ever wider
    windows take off what is narrower; what an opening lowers by more than steep ground could rise between two
    windows is a thing, and so are its splats down to the ground around it.

    Args:
        centers: of splats (splat, 3), m.
        spacing: of splats on the ground, m.
        width: of the widest thing, m.
    """
    from scipy.ndimage import distance_transform_edt, grey_opening

    cell = max(CELL_SPACINGS * spacing, width / MOST_CELLS)
    place = ((centers[:, :2] - centers[:, :2].min(axis=0)) / cell).astype(np.int64)
    top = np.full(place.max(axis=0) + 1, -np.inf)
    np.maximum.at(top, tuple(place.T), centers[:, 2])
    nearest = distance_transform_edt(np.isinf(top), return_distances=False, return_indices=True)
    ground = top[tuple(nearest)]
    things = np.zeros(top.shape, bool)
    for window in range(3, int(np.ceil(width / cell)) + 3, 2):
        opened = grey_opening(ground, size=(window, window), mode="nearest")
        things |= ground - opened > STEEPEST * 2 * cell + LEAST_RISE
        ground = opened
    here = tuple(place.T)
    standing: np.ndarray = things[here] & (centers[:, 2] > ground[here] + LEAST_RISE)
    return standing


def occupied_area(centers: Float64Array, spacing: float) -> float:
    """Return the area in plan of the cells with a splat in them, m2."""
    cell = CELL_SPACINGS * spacing
    return len(np.unique((centers[:, :2] // cell).astype(np.int64), axis=0)) * cell**2
