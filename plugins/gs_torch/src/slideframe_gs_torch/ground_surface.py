"""The height of the ground over the plan, between and beyond the survey's sparse points."""

from typing import Self

import numpy as np
from scipy.interpolate import RBFInterpolator, RegularGridInterpolator
from scipy.spatial import cKDTree

from slideframe.arrays import Float32Array, Float64Array

FEWEST_POINTS = 20
# A thin plate through the nearest points, with lengths in units of the site's: how far it may pass a point by.
NEIGHBOURS, SMOOTHING = 100, 5e-4
# A point this many deviations off its neighbours' heights is a mistake, or a wall's.
OUTLIER_NEIGHBOURS, OUTLIER_DEVIATIONS = 20, 6.0
# The surface is kept on a grid of this many nodes a side, which goes on this share of the site's length beyond it; from
# there it goes on straight.
NODES, BEYOND_SHARE = 96, 0.35
# Rays that fall less than this per metre meet the ground too far away to say where.
LEAST_FALL = 0.05
# Steps towards where a ray meets the ground: by this share of what is missing to the height below, since whole steps
# would overshoot where the ground rises as steeply as the ray falls.
STEPS, STEP_SHARE = 12, 0.6


class GroundSurface:
    """A smooth surface through sparse points: where one photograph alone shows the ground, the best guess."""

    def __init__(self, axes: tuple[Float64Array, Float64Array], heights: Float64Array) -> None:
        """Take a grid: x (column,), y (row,) and heights (column, row), m."""
        self._grid = RegularGridInterpolator(axes, heights, bounds_error=False, fill_value=None)

    @classmethod
    def of(cls, points: Float32Array) -> Self | None:
        """Fit the surface to points (point, 3), m; None where they are too few or in one line of the plan."""
        points = without_outliers(points.astype(np.float64))
        if len(points) < FEWEST_POINTS:
            return None
        low, high = np.quantile(points[:, :2], [0.005, 0.995], axis=0)
        length = float((high - low).max())
        middle = (low + high) / 2
        plan = (points[:, :2] - middle) / max(length, 1e-9)
        axes = tuple(
            np.linspace(low[k] - BEYOND_SHARE * length, high[k] + BEYOND_SHARE * length, NODES) for k in range(2)
        )
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        try:
            plate = RBFInterpolator(
                plan, points[:, 2], neighbors=min(NEIGHBOURS, len(points)), smoothing=SMOOTHING,
                kernel="thin_plate_spline",
            )  # fmt: skip
            heights = plate((nodes - middle) / max(length, 1e-9))
        except np.linalg.LinAlgError:
            return None
        return cls((axes[0], axes[1]), heights.reshape(NODES, NODES))

    def heights(self, plan: Float64Array) -> Float64Array:
        """Return heights (place,), m, at places (place, 2)."""
        return np.asarray(self._grid(plan))

    def met_by(
        self, viewpoint: Float64Array, rays: Float64Array, nearest: Float64Array, farthest: Float64Array
    ) -> Float64Array:
        """Return how many times a ray (ray, 3) leads from a viewpoint (3,) to the ground, within bounds (ray,).

        NaN where the ray hardly falls.
        """
        falls = rays[:, 2] < -LEAST_FALL * np.linalg.norm(rays, axis=1)
        found = np.full(len(rays), np.nan)
        rays, nearest, farthest = rays[falls], nearest[falls], farthest[falls]
        reach = (nearest + farthest) / 2
        for _ in range(STEPS):
            ground = self.heights(viewpoint[:2] + reach[:, None] * rays[:, :2])
            level = (ground - viewpoint[2]) / rays[:, 2]
            reach = (reach + STEP_SHARE * (level - reach)).clip(nearest, farthest)
        found[falls] = reach
        return found


def without_outliers(points: Float64Array) -> Float64Array:
    """Return the points (point, 3) whose heights are like those of their neighbours in plan."""
    if len(points) <= OUTLIER_NEIGHBOURS:
        return points
    _, near = cKDTree(points[:, :2]).query(points[:, :2], k=OUTLIER_NEIGHBOURS)
    around = points[near, 2]
    middle = np.median(around, axis=1)
    spread = np.median(np.abs(around - middle[:, None]), axis=1)
    return points[np.abs(points[:, 2] - middle) <= OUTLIER_DEVIATIONS * np.maximum(spread, np.median(spread))]
