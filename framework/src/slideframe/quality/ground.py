"""What the photographs see of the ground: how many, from which angles and distances, in what detail."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.photographs import distort
from slideframe.products import Camera, Survey

Grid = npt.NDArray[np.float64]
Bounds = tuple[float, float, float, float]

POINTS_PER_CELL = 4  # sparse points that a cell should hold on average, so that its height is a median, not a whim
FEWEST_CELLS, MOST_CELLS = 12, 120  # along the longer side
# A gap without sparse points is bridged this many cells wide; beyond lies ground that nobody reconstructed.
BRIDGED_CELLS = 2
# Chords are measured along directions 15 degrees or less from any other, so 3.5 % too short at worst.
CHORD_DIRECTIONS = 48
# Half a picture's slopes, and 40 % more: strong barrel distortion of a drone's wide lens shows 20 % more.
BEYOND_PINHOLE = 0.7


@dataclass(frozen=True, eq=False)
class GroundCoverage:
    """A grid over the mapped ground, rows from south to north, columns from west to east.

    Cells without ground hold NaN, or 0 in `views`. Ground that hides other ground is neglected.

    Attributes:
        west, south: the grid's corner, m.
        cell: side of a cell, m.
        height: (row, column) m.
        views: (row, column) photographs that see the cell.
        angle: (row, column) degrees, the largest angle between two views.
        distance_ratio: (row, column) farthest over closest view.
        sampling: (row, column) m, ground that a pixel covers in the closest view, across the line of sight.
    """

    west: float
    south: float
    cell: float
    height: Grid
    views: npt.NDArray[np.int64]
    angle: Grid
    distance_ratio: Grid
    sampling: Grid

    @property
    def mapped(self) -> npt.NDArray[np.bool_]:
        """Which cells hold ground."""
        return np.isfinite(self.height)

    def share_seen_by(self, least: int) -> float:
        """Return the share of the mapped ground that at least so many photographs see."""
        return float(np.mean(self.views[self.mapped] >= least)) if self.mapped.any() else 0.0


def cover_ground(survey: Survey, bounds: Bounds | None = None) -> GroundCoverage:
    """Look at the ground that the sparse points show, or at the part of it within (x_min, x_max, y_min, y_max)."""
    west, south, cell, height = _height_grid(np.asarray(survey.sparse_points, np.float64), bounds)
    rows, columns = np.nonzero(np.isfinite(height))
    places = np.column_stack([west + (columns + 0.5) * cell, south + (rows + 0.5) * cell, height[rows, columns]])
    views, chord, nearest, farthest, sampling = _look_at(survey, places)

    def grid(values: npt.NDArray[np.float64]) -> Grid:
        full = np.full(height.shape, np.nan)
        full[rows, columns] = np.where(views > 0, values, np.nan)
        return full

    counts = np.zeros(height.shape, np.int64)
    counts[rows, columns] = views
    return GroundCoverage(
        west=west,
        south=south,
        cell=cell,
        height=height,
        views=counts,
        angle=grid(np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))),
        distance_ratio=grid(farthest / np.maximum(nearest, 1e-9)),
        sampling=grid(sampling),
    )


def _height_grid(points: Float64Array, bounds: Bounds | None) -> tuple[float, float, float, Grid]:
    """Return west, south, cell size and the median height of each cell, NaN beyond the ground."""
    if bounds is not None:
        x_min, x_max, y_min, y_max = bounds
        inside = (points[:, 0] >= x_min) & (points[:, 0] <= x_max) & (points[:, 1] >= y_min) & (points[:, 1] <= y_max)
        points = points[inside]
    if len(points) < 3:
        return 0.0, 0.0, 1.0, np.full((1, 1), np.nan)
    low, high = np.percentile(points[:, :2], [0.5, 99.5], axis=0)  # a few stray points don't make ground
    extent = np.maximum(high - low, 1e-3)
    cells = np.clip(np.sqrt(len(points) / POINTS_PER_CELL), FEWEST_CELLS, MOST_CELLS)
    cell = float(extent.max() / cells)
    columns, rows = np.floor((points[:, :2] - low) / cell).astype(int).T
    shape = tuple(int(count) for count in np.ceil(extent[::-1] / cell).clip(1))
    inside = (rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1])
    height = np.full(shape, np.nan)
    order = np.lexsort((points[inside, 2], rows[inside] * shape[1] + columns[inside]))
    flat = (rows[inside] * shape[1] + columns[inside])[order]
    first, start, count = np.unique(flat, return_index=True, return_counts=True)
    height.ravel()[first] = points[inside, 2][order][start + count // 2]
    return float(low[0]), float(low[1]), cell, _without_holes(height)


def _without_holes(height: Grid) -> Grid:
    """Fill gaps of a few cells by the mean of their neighbours, then draw the rim back to where it was."""
    known = np.isfinite(height)
    grown, filled = known.copy(), height.copy()
    for _ in range(BRIDGED_CELLS):
        total, count = _neighbour_sum(np.where(grown, filled, 0.0)), _neighbour_sum(grown.astype(float))
        fresh = ~grown & (count > 0)
        filled[fresh] = total[fresh] / count[fresh]
        grown |= fresh
    kept = grown
    for _ in range(BRIDGED_CELLS):
        kept = kept & (_neighbour_sum(kept.astype(float), outside=1.0) == 8)
    return np.where(known | kept, filled, np.nan)


def _neighbour_sum(values: Grid, outside: float = 0.0) -> Grid:
    """Return the sum over the eight neighbours of each cell."""
    padded = np.pad(values, 1, constant_values=outside)
    rows, columns = values.shape
    total = sum(padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3))
    result: Grid = total - values
    return result


def _look_at(survey: Survey, places: Float64Array) -> tuple[npt.NDArray[np.int64], Grid, Grid, Grid, Grid]:
    """Return per place: views, the longest chord between two unit rays, nearest, farthest, and finest pixel, m."""
    count, directions = len(places), _directions(CHORD_DIRECTIONS)
    views = np.zeros(count, np.int64)
    nearest, farthest = np.full(count, np.inf), np.zeros(count)
    sampling = np.full(count, np.inf)
    low = np.full((count, CHORD_DIRECTIONS), np.inf, np.float32)
    high = np.full((count, CHORD_DIRECTIONS), -np.inf, np.float32)
    for index, pose in enumerate(survey.world_from_camera):
        camera = survey.camera_of(index)
        in_camera = (places - pose[:, 3]) @ pose[:, :3]
        seen, depth = _inside(camera, in_camera), in_camera[:, 2]
        rays = pose[:, 3] - places[seen]
        distance = np.linalg.norm(rays, axis=1)
        views[seen] += 1
        nearest[seen] = np.minimum(nearest[seen], distance)
        farthest[seen] = np.maximum(farthest[seen], distance)
        sampling[seen] = np.minimum(sampling[seen], depth[seen] / camera.focal_x)
        along = (rays / distance[:, None] @ directions.T).astype(np.float32)
        low[seen] = np.minimum(low[seen], along)
        high[seen] = np.maximum(high[seen], along)
    chord = np.where(views > 0, (high - low).max(axis=1, initial=0.0), 0.0)
    return views, chord.astype(np.float64), nearest, farthest, sampling


def _inside(camera: Camera, in_camera: Float64Array) -> npt.NDArray[np.bool_]:
    """Return (place,) whether places (place, 3) in camera axes fall into the picture, through the lens.

    A lens polynomial turns back far outside of the picture, so only places near it are put through.
    """
    slopes = in_camera[:, :2] / np.maximum(in_camera[:, 2:], 1e-9)
    reach = BEYOND_PINHOLE * np.array([camera.width / camera.focal_x, camera.height / camera.focal_y])
    inside: npt.NDArray[np.bool_] = (in_camera[:, 2] > 0) & (np.abs(slopes) < reach).all(axis=1)
    seen = distort(slopes[inside], camera.distortion)
    column = seen[:, 0] * camera.focal_x + camera.principal_x
    row = seen[:, 1] * camera.focal_y + camera.principal_y
    inside[inside] = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return inside


def _directions(count: int) -> Float64Array:
    """Return unit vectors (count, 3) spread evenly over a hemisphere, along a spiral of Fibonacci."""
    index = np.arange(count) + 0.5
    up = index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    flat = np.sqrt(1 - up * up)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), up])
