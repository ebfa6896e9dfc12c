"""Points between the survey's sparse ones, so that training starts with as much detail everywhere.

Where few photographs overlap the survey has few points, or none; splats would have to grow there from far away. In each
photograph the sparse points' inverse depths, which are linear over a plane, are interpolated between them. Beyond them,
where often no other photograph could correct a guess, a smooth ground goes on through the points of the whole survey.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Camera, Survey
from slideframe_gs_torch.depth_points import depth_points
from slideframe_gs_torch.ground_surface import GroundSurface
from slideframe_gs_torch.views import TrainingView

# Side of the cells, px, each of which gets a point if it has none; the smallest that keeps to the number wanted.
CELLS_PX = (32, 24, 16, 12, 10, 8, 7, 6, 5, 4, 3, 2)
FEWEST_IN_VIEW = 8
# Beyond the sparse points no depth is taken to differ more than by this factor from the nearest one.
FARTHEST = 1.5


def dense_points(survey: Survey, views: Sequence[TrainingView], most: int) -> tuple[Float32Array, Float32Array]:
    """Return at most `most` points (point, 3), m, the sparse ones first, and their colours (point, 3), 0 to 1."""
    sparse = survey.sparse_points.astype(np.float64), survey.sparse_colors / 255
    if len(survey.sparse_points) > most:
        return survey.sparse_points, sparse[1].astype(np.float32)
    ground = GroundSurface.of(survey.sparse_points)
    depths = [ViewDepths.of(survey.sparse_points, view, ground) for view in views]
    found = sparse
    for cell in CELLS_PX:
        filled = sparse
        for view, known in zip(views, depths, strict=True):
            if known is not None and len(filled[0]) <= most:
                added = points_in_empty_cells(filled[0], view, known, cell)
                filled = np.concatenate([filled[0], added[0]]), np.concatenate([filled[1], added[1]])
        if len(filled[0]) > most:
            break
        found = filled
    return found[0].astype(np.float32), found[1].astype(np.float32)


class ViewDepths:
    """The depths of a view, from its sparse points and the ground beyond them."""

    def __init__(
        self, view: TrainingView, places: Float64Array, inverse: Float64Array, ground: GroundSurface | None
    ) -> None:
        """Take the pixels (point, 2) and inverse depths (point,), 1/m, of the points seen."""
        self._view, self._inverse, self._ground = view, inverse, ground
        self._between = LinearNDInterpolator(places, inverse)
        self._tree = cKDTree(places)
        self._places = places
        self._slope = np.linalg.lstsq(np.column_stack([places, np.ones(len(places))]), inverse, rcond=None)[0][:2]

    @classmethod
    def of(cls, points: Float32Array, view: TrainingView, ground: GroundSurface | None) -> "ViewDepths | None":
        """Return what the sparse points (point, 3) say, or None where they are too few or on one line."""
        known = depth_points(points, view.camera, view.world_from_camera)
        if known is None or len(known.depths) < FEWEST_IN_VIEW:
            return None
        places = np.column_stack([known.columns.numpy(), known.rows.numpy()]) + 0.5
        if np.linalg.matrix_rank(places - places.mean(axis=0)) < 2:
            return None
        return cls(view, places, 1 / known.depths.double().numpy(), ground)

    def at(self, places: Float64Array) -> Float64Array:
        """Return depths (place,), m, at pixels (place, 2)."""
        inverse = self._between(places)
        beyond = np.isnan(inverse)
        inverse[beyond] = self._beyond(places[beyond])
        return np.asarray(1 / inverse)

    def _beyond(self, places: Float64Array) -> Float64Array:
        """Return inverse depths where the ground is met, and where it isn't those of the plane that fits best."""
        _, nearest = self._tree.query(places)
        base = self._inverse[nearest]
        plane = (base + (places - self._places[nearest]) @ self._slope).clip(base / FARTHEST, base * FARTHEST)
        if self._ground is None:
            return np.asarray(plane)
        pose = self._view.world_from_camera
        rays = pixel_rays(places, self._view.camera) @ pose[:, :3].T
        reach = self._ground.met_by(pose[:, 3], rays, 1 / (base * FARTHEST), FARTHEST / base)
        return np.where(np.isnan(reach), plane, 1 / reach)


def points_in_empty_cells(
    points: Float64Array, view: TrainingView, depths: ViewDepths, cell: int
) -> tuple[Float64Array, Float64Array]:
    """Return a point (new, 3) and its colour (new, 3) for each cell of `cell` px that shows none of the points."""
    camera, pose = view.camera, view.world_from_camera
    rows, columns = camera.height // cell, camera.width // cell
    empty = ~cells_with_points(points, view, cell)
    colours = view.pixels[:, : rows * cell, : columns * cell].numpy().reshape(3, rows, cell, columns, cell)
    if view.mask is not None:
        seen = view.mask[: rows * cell, : columns * cell].numpy().reshape(rows, cell, columns, cell)
        empty &= seen.all(axis=(1, 3))
    row, column = np.nonzero(empty)
    places = (np.column_stack([column, row]) + 0.5) * cell
    local = pixel_rays(places, camera) * depths.at(places)[:, None]
    return local @ pose[:, :3].T + pose[:, 3], colours.mean(axis=(2, 4))[:, row, column].T / 255


def cells_with_points(points: Float64Array, view: TrainingView, cell: int) -> npt.NDArray[np.bool_]:
    """Tell which cells (row, column) of a view show a point."""
    shape = view.camera.height // cell, view.camera.width // cell
    pixels, before = pixels_of(points, view.camera, view.world_from_camera)
    column, row = np.floor(pixels[before] / cell).T
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    shown = np.zeros(shape, bool)
    shown[row[inside].astype(int), column[inside].astype(int)] = True
    return shown


def pixel_rays(places: Float64Array, camera: Camera) -> Float64Array:
    """Return the rays (place, 3), in camera axes and with z = 1, of places (place, 2), px."""
    slopes = (places - [camera.principal_x, camera.principal_y]) / [camera.focal_x, camera.focal_y]
    return np.column_stack([slopes, np.ones(len(slopes))])


def pixels_of(
    points: Float64Array, camera: Camera, world_from_camera: Float64Array
) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
    """Return where points (point, 3) are seen without distortion (point, 2), px, and which lie before the camera."""
    local = (points - world_from_camera[:, 3]) @ world_from_camera[:, :3]
    depth = np.where(local[:, 2] > 0, local[:, 2], 1.0)[:, None]
    pixels = local[:, :2] / depth * [camera.focal_x, camera.focal_y] + [camera.principal_x, camera.principal_y]
    return pixels, local[:, 2] > 0
