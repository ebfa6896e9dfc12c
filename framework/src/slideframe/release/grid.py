"""Heights of ground and slip surface over the plan of the moving mass."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array, Int32Array
from slideframe.products import Georeference
from slideframe.release.plan import Plan

TRIANGLES_AT_ONCE = 20_000


@dataclass(frozen=True)
class Area:
    """A grid over the plan, and the ground there.

    Attributes:
        plan: the area of the moving mass.
        ground: returns the highest ground at (x, y), minus infinity where there is none, m.
        x: eastings of the nodes (column,), m.
        y: northings of the nodes (row,), m.
        georeference: the survey's.
    """

    plan: Plan
    ground: Callable[[Float64Array, Float64Array], Float64Array]
    x: Float64Array
    y: Float64Array
    georeference: Georeference

    @cached_property
    def across(self) -> Float64Array:
        """Easting of every node (column, row), m."""
        return np.repeat(self.x[:, None], len(self.y), axis=1)

    @cached_property
    def along(self) -> Float64Array:
        """Northing of every node (column, row), m."""
        return np.repeat(self.y[None, :], len(self.x), axis=0)

    @cached_property
    def heights(self) -> Float64Array:
        """Highest ground (column, row), m; minus infinity where there is none."""
        found: Float64Array = self.ground(self.across.ravel(), self.along.ravel()).reshape(self.across.shape)
        return found

    def known(self, heights: Float64Array) -> Float64Array:
        """Return heights with NaN where there is no ground."""
        return np.where(np.isfinite(self.heights), heights, np.nan)


@dataclass(frozen=True)
class ReleaseGrid:
    """Two height fields on a grid that reaches over the plan on every side.

    Attributes:
        x: eastings of the nodes (column,), m.
        y: northings of the nodes (row,), m.
        ground: highest ground (column, row), m; minus infinity where there is none.
        base: slip surface (column, row), m; NaN where nothing moves.
        figures: how the slip surface came about, units in the names.
    """

    x: Float64Array
    y: Float64Array
    ground: Float64Array
    base: Float64Array
    figures: dict[str, float] = field(default_factory=dict)

    def base_at(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> Float64Array:
        """Interpolate the slip surface between nodes; NaN where nothing moves or the grid ends."""
        return bilinear(self.x, self.y, self.base, x, y)


def bilinear(
    x: Float64Array,
    y: Float64Array,
    values: Float64Array,
    at_x: npt.NDArray[np.floating],
    at_y: npt.NDArray[np.floating],
) -> Float64Array:
    """Interpolate `values` (column, row), given at evenly spaced `x` and `y`; NaN outside."""
    across = (np.asarray(at_x, np.float64) - x[0]) / (x[1] - x[0])
    along = (np.asarray(at_y, np.float64) - y[0]) / (y[1] - y[0])
    outside = ~((across >= 0) & (across <= len(x) - 1) & (along >= 0) & (along <= len(y) - 1))
    across, along = np.where(outside, 0.0, across), np.where(outside, 0.0, along)
    column = np.minimum(across.astype(np.int64), len(x) - 2)
    row = np.minimum(along.astype(np.int64), len(y) - 2)
    right, up = across - column, along - row
    south = _between(values[column, row], values[column + 1, row], right)
    north = _between(values[column, row + 1], values[column + 1, row + 1], right)
    return np.where(outside, np.nan, _between(south, north, up))


def lowest_heights(x: Float64Array, y: Float64Array, vertices: Float64Array, triangles: Int32Array) -> Float64Array:
    """Return the height of the lowest triangle at each node (column, row), m; NaN where there is none.

    Args:
        x: evenly spaced eastings (column,), m.
        y: evenly spaced northings (row,), m.
        vertices: (vertex, 3), m.
        triangles: (triangle, 3).
    """
    heights = np.full(len(x) * len(y), np.inf)
    for first in range(0, len(triangles), TRIANGLES_AT_ONCE):
        corners = vertices[triangles[first : first + TRIANGLES_AT_ONCE]]
        node, height = _nodes_under(corners, x, y)
        np.minimum.at(heights, node, height)
    return np.where(np.isfinite(heights), heights, np.nan).reshape(len(x), len(y))


def _nodes_under(corners: Float64Array, x: Float64Array, y: Float64Array) -> tuple[npt.NDArray[np.int64], Float64Array]:
    """Return the nodes that lie in triangles (triangle, 3, 3) seen from above, and the triangles' heights there."""
    low, counts = [], []
    for axis, values in enumerate((x, y)):
        place = (corners[:, :, axis] - values[0]) / (values[1] - values[0])
        start = np.clip(np.ceil(place.min(axis=1) - 1e-9), 0, len(values)).astype(np.int64)
        end = np.clip(np.floor(place.max(axis=1) + 1e-9), -1, len(values) - 1).astype(np.int64)
        low.append(start)
        counts.append(np.maximum(end - start + 1, 0))
    number = counts[0] * counts[1]
    which = np.repeat(np.arange(len(corners)), number)
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    column = low[0][which] + within // np.maximum(counts[1][which], 1)
    row = low[1][which] + within % np.maximum(counts[1][which], 1)
    a, b, c = corners[which].transpose(1, 0, 2)
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    upright = np.abs(twice) < 1e-15
    twice = np.where(upright, 1.0, twice)
    px, py = x[column] - a[:, 0], y[row] - a[:, 1]
    second = (px * (c[:, 1] - a[:, 1]) - py * (c[:, 0] - a[:, 0])) / twice
    third = (py * (b[:, 0] - a[:, 0]) - px * (b[:, 1] - a[:, 1])) / twice
    inside = ~upright & (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)
    height = a[:, 2] + second * (b[:, 2] - a[:, 2]) + third * (c[:, 2] - a[:, 2])
    return (column * len(y) + row)[inside], height[inside]


def _between(first: Float64Array, second: Float64Array, share: Float64Array) -> Float64Array:
    """Weigh two values, without letting a NaN of weight 0 count."""
    mixed: Float64Array = np.where(share <= 0, first, np.where(share >= 1, second, first + share * (second - first)))
    return mixed
