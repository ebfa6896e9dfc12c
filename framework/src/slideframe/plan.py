"""The site from above, in square columns."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array

# particles beyond this share of the rest, on each side, don't widen the plan
OUTLIERS = 0.001


@dataclass(frozen=True)
class PlanGrid:
    """Columns of ground; row 0 is the northernmost, column 0 the westernmost.

    Attributes:
        west: edge of the first column, m east of the origin.
        north: edge of the first row, m north of the origin.
        cell: side of a column, m.
        shape: number of rows and columns.
    """

    west: float
    north: float
    cell: float
    shape: tuple[int, int]

    @classmethod
    def covering(
        cls, clouds: Iterable[Float32Array], cell: float, corner: Float64Array | tuple[float, float] = (0.0, 0.0)
    ) -> "PlanGrid":
        """Return the grid that covers the clouds' points (n, 3), but for outliers, with a column to spare.

        `corner` (2,), m, is where corners of columns meet.
        """
        ends = [np.quantile(cloud[:, :2], [OUTLIERS, 1 - OUTLIERS], axis=0) - corner for cloud in clouds]
        low = np.floor(np.min([low for low, _ in ends], axis=0) / cell - 1) * cell + corner
        high = np.ceil(np.max([high for _, high in ends], axis=0) / cell + 1) * cell + corner
        columns, rows = np.rint((high - low) / cell).astype(int)
        return cls(float(low[0]), float(high[1]), cell, (int(rows), int(columns)))

    def thickness(self, positions: Float32Array, volumes: Float32Array) -> Float64Array:
        """Return the soil in each column as a height (row, column), m, from particles (n, 3) and their volumes, m3."""
        column = np.floor((positions[:, 0].astype(np.float64) - self.west) / self.cell).astype(np.int64)
        row = np.floor((self.north - positions[:, 1].astype(np.float64)) / self.cell).astype(np.int64)
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        places = row[inside] * self.shape[1] + column[inside]
        total = np.bincount(places, volumes[inside].astype(np.float64), minlength=self.shape[0] * self.shape[1])
        return np.asarray(total.reshape(self.shape) / self.cell**2, np.float64)
