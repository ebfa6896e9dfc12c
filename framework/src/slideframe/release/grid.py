"""Heights of ground and slip surface over the plan of the moving mass."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array


@dataclass(frozen=True)
class ReleaseGrid:
    """Two height fields on a grid that reaches over the plan on every side.

    Attributes:
        x: eastings of the nodes (column,), m.
        y: northings of the nodes (row,), m.
        ground: highest ground (column, row), m; minus infinity where there is none.
        base: slip surface (column, row), m; NaN where nothing moves.
    """

    x: Float64Array
    y: Float64Array
    ground: Float64Array
    base: Float64Array

    @property
    def spacing(self) -> tuple[float, float]:
        """Distance of nodes along x and y, m."""
        return float(self.x[1] - self.x[0]), float(self.y[1] - self.y[0])

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


def _between(first: Float64Array, second: Float64Array, share: Float64Array) -> Float64Array:
    """Weigh two values, without letting a NaN of weight 0 count."""
    mixed: Float64Array = np.where(share <= 0, first, np.where(share >= 1, second, first + share * (second - first)))
    return mixed
