"""Smooth random fields on regular grids, defined in metres so that a finer grid shows the same ground."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from slideframe.arrays import Float32Array, Float64Array

Spacing = float | tuple[float, float]

TABLE_SIZE = 512
# The B-spline averages neighbours, so a uniform table of (-1, 1) comes out with a deviation of 0.26: bring it near 0.5.
SPLINE_GAIN = np.float32(1.9)
# An octave this many cells wide is straight between every fourth sample to 1 % of its height.
SMOOTH_CELLS = 12
COARSER = 4


def smooth_noise(x: Float64Array, y: Float64Array, spacing: Spacing, seed: int) -> Float32Array:
    """Return noise of about (-1, 1) with features of `spacing` metres (or one spacing along x, one along y).

    Uniform random numbers on a lattice, joined by uniform cubic B-splines. The lattice repeats after
    512 spacings.

    Args:
        x: east coordinates of the grid's columns (column,), m.
        y: north coordinates of the grid's rows (row,), m.
        spacing: distance of the lattice's points, m.
        seed: one seed, one field.

    Returns:
        The field (row, column).
    """
    return fractal_noise(x, y, (spacing,), seed)


def fractal_noise(
    x: Float64Array, y: Float64Array, spacings: Sequence[Spacing], seed: int, *, roughness: float = 0.5
) -> Float32Array:
    """Add octaves of noise, coarse to fine, each `roughness` times the one before.

    Octaves finer than a cell of the grid are left out: it can't show them.
    """
    cell = float(x[1] - x[0])
    field = np.zeros((len(y), len(x)), np.float32)
    smooth = []
    for octave, spacing in enumerate(spacings):
        finest = min(spacing) if isinstance(spacing, tuple) else spacing
        part = (spacing, seed + octave, np.float32(roughness**octave))
        if finest >= SMOOTH_CELLS * cell:
            smooth.append(part)
        elif finest >= cell:
            _add_octave(field, x, y, *part)
    if smooth:
        few_x, few_y = _every_fourth(x), _every_fourth(y)
        few = np.zeros((len(few_y), len(few_x)), np.float32)
        for part in smooth:
            _add_octave(few, few_x, few_y, *part)
        field += _refine(_refine(few, len(y)).T, len(x)).T
    return field


def speckle(x: Float64Array, y: Float64Array, seed: int) -> Float32Array:
    """Return one random number of (-1, 1) for every cell of the grid (row, column)."""
    cell = float(x[1] - x[0])
    rows, columns = (np.floor(axis / cell).astype(np.int64) % TABLE_SIZE for axis in (y, x))
    field: Float32Array = np.take(_random_table(seed)[rows], columns, axis=1)
    return field


def ridges(field: Float32Array) -> Float32Array:
    """Turn a field's zero crossings into sharp crests of height 1, falling to 0 where |field| is 1 or more."""
    crests: Float32Array = np.maximum(1 - np.abs(field), 0)
    return crests * crests


def step(field: Float32Array, low: float, high: float) -> Float32Array:
    """Rise smoothly from 0 at `low` to 1 at `high` (3 t^2 - 2 t^3)."""
    share: Float32Array = np.clip((field - np.float32(low)) * np.float32(1 / (high - low)), 0, 1)
    return share * share * (3 - 2 * share)


def _add_octave(
    field: Float32Array, x: Float64Array, y: Float64Array, spacing: Spacing, seed: int, strength: np.float32
) -> None:
    along_x, along_y = spacing if isinstance(spacing, tuple) else (spacing, spacing)
    table = _random_table(seed)
    columns, column_weights = _spline(x, along_x)
    rows, row_weights = _spline(y, along_y)
    lines = np.zeros((len(y), TABLE_SIZE), np.float32)
    for row, weight in zip(rows, row_weights, strict=True):
        lines += (SPLINE_GAIN * strength * weight)[:, None] * table[row]
    for column, weight in zip(columns, column_weights, strict=True):
        field += weight * np.take(lines, column, axis=1)


@lru_cache(maxsize=128)
def _random_table(seed: int) -> Float32Array:
    generator = np.random.Generator(np.random.PCG64(seed))
    return 2 * generator.random((TABLE_SIZE, TABLE_SIZE), dtype=np.float32) - 1


def _every_fourth(axis: Float64Array) -> Float64Array:
    """Return every fourth coordinate, from the first to the last or beyond."""
    count = -(-(len(axis) - 1) // COARSER) + 1
    coarse: Float64Array = axis[0] + COARSER * (axis[1] - axis[0]) * np.arange(count)
    return coarse


def _refine(field: Float32Array, count: int) -> Float32Array:
    """Interpolate rows linearly between every fourth, and keep the first `count`."""
    share = (np.arange(COARSER, dtype=np.float32) / COARSER)[None, :, None]
    between = field[:-1, None] + share * (field[1:, None] - field[:-1, None])
    rows = between.reshape(-1, field.shape[1])
    return np.concatenate([rows, field[-1:]])[:count]


def _spline(coordinate: Float64Array, spacing: float) -> tuple[list[np.ndarray], list[Float32Array]]:
    """Return the four lattice indices and B-spline weights of every coordinate."""
    position = coordinate / spacing
    cell = np.floor(position)
    t = (position - cell).astype(np.float32)
    first = cell.astype(np.int64) - 1
    weights = [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6]
    return [(first + k) % TABLE_SIZE for k in range(4)], [weight.astype(np.float32) for weight in weights]
