"""Fields on a regular grid of the ground, and how to look them up."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array


@dataclass(frozen=True)
class GroundGrid:
    """A square grid of samples centred on the frame's origin, row 0 in the south, column 0 in the west.

    Attributes:
        spacing: distance of neighbouring samples, m.
        count: samples along a side.
    """

    spacing: float
    count: int

    @property
    def start(self) -> float:
        """Coordinate of the first sample, m."""
        return -0.5 * (self.count - 1) * self.spacing

    @property
    def axis(self) -> Float64Array:
        """Coordinates of the samples along a side (count,), m."""
        return self.start + self.spacing * np.arange(self.count, dtype=np.float64)

    def lookup(self, field: Float32Array, x: Float32Array, y: Float32Array) -> Float32Array:
        """Interpolate bilinearly at points of any shape; points outside take the value at the edge."""
        index, right, up = self._cell(x, y)
        flat = field.reshape(-1)
        low = _between(flat, index, right)
        return low + up * (_between(flat, index + self.count, right) - low)

    def resample(self, field: Float32Array, x: Float64Array, y: Float64Array) -> Float32Array:
        """Interpolate bilinearly on another grid with columns `x` and rows `y`."""
        row, up = self._share(y)
        column, right = self._share(x)
        lines = field[row] + up[:, None] * (field[row + 1] - field[row])
        west: Float32Array = np.take(lines, column, axis=1)
        east: Float32Array = np.take(lines, column + 1, axis=1)
        return west + right * (east - west)

    def _cell(self, x: Float32Array, y: Float32Array) -> tuple[np.ndarray, Float32Array, Float32Array]:
        column, right = self._share(x)
        row, up = self._share(y)
        return row * np.int32(self.count) + column, right, up

    def _share(self, coordinate: np.ndarray) -> tuple[np.ndarray, Float32Array]:
        """Return the sample before each coordinate and the share of the way to the next."""
        position = np.clip((coordinate - self.start) * (1 / self.spacing), 0, self.count - 1).astype(np.float32)
        sample = np.minimum(position.astype(np.int32), np.int32(self.count - 2))
        return sample, position - sample


def _between(flat: Float32Array, index: np.ndarray, share: Float32Array) -> Float32Array:
    # take with mode="clip" skips the bounds check; the indices are inside by construction
    first = np.take(flat, index, mode="clip").astype(np.float32, copy=False)
    return first + share * (np.take(flat, index + 1, mode="clip") - first)
