"""The order in which the compiled kernels draw one view, on NumPy arrays."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array, Int32Array, UInt8Array
from slideframe.products import Camera
from slideframe_gs_torch import binning_kernels as binning
from slideframe_gs_torch import compositing_kernels as compositing
from slideframe_gs_torch import harmonics_kernels as harmonics
from slideframe_gs_torch import projection_gradient_kernels as projection_gradient
from slideframe_gs_torch import projection_kernels as projection
from slideframe_gs_torch.threads import run_shares

NO_BACKGROUND = np.zeros(compositing.CHANNELS, np.float32)
NO_FRAMES = np.empty((1, 0, 0), np.float32)


@dataclass(frozen=True)
class View:
    """What the kernels know of the camera: (3, 4), (fx, fy, cx, cy, width, height) and the mip filter."""

    camera_from_world: Float64Array
    intrinsics: Float64Array
    antialiased: bool = False

    @classmethod
    def of(cls, camera: Camera, camera_from_world: Float64Array, antialiased: bool = False) -> Self:
        """Flatten a camera."""
        intrinsics = (
            camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y, camera.width, camera.height
        )  # fmt: skip
        return cls(np.ascontiguousarray(camera_from_world), np.array(intrinsics, np.float64), antialiased)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, px."""
        return int(self.intrinsics[5]), int(self.intrinsics[4])

    @property
    def pixel_count(self) -> int:
        """Number of pixels."""
        return self.size[0] * self.size[1]

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        height, width = self.size
        return -(-height // binning.TILE_HEIGHT), -(-width // binning.TILE_WIDTH)

    @property
    def viewpoint(self) -> Float64Array:
        """Where the camera stands (3,), m."""
        return -self.camera_from_world[:, :3].T @ self.camera_from_world[:, 3]


class Splats(NamedTuple):
    """What is drawn, or its gradient: see `rasterize`. Colours are (splat, 3) or harmonics (splat, coefficient, 3)."""

    centers: Float32Array
    rotations: Float32Array
    scales: Float32Array
    opacities: Float32Array
    colours: Float32Array

    @property
    def block_count(self) -> int:
        """Number of blocks that projection works in."""
        return -(-len(self.centers) // projection.BLOCK)


@dataclass(frozen=True)
class TileLists:
    """Which splats each tile draws, near to far, and where in their gradients its part goes."""

    order: Int32Array
    screen: Float32Array
    starts: npt.NDArray[np.int64]
    splats: Int32Array
    rows: UInt8Array
    slots: Int32Array
    slot_starts: Int32Array
    slot_counts: Int32Array


@dataclass(frozen=True)
class Drawing:
    """A drawn view and what its gradient needs."""

    image: Float32Array
    transmittance: Float32Array
    screen: Float32Array
    colours: Float32Array
    background: Float32Array
    lists: TileLists
    taken: Float32Array
    processed: npt.NDArray[np.int64]


@dataclass(frozen=True)
class DrawingGradient:
    """The gradients of the splats, of the pose, and the screen gradients (splat, 2)."""

    splats: Splats
    camera_from_world: Float64Array
    means: Float32Array


def in_view(centers: Float32Array, log_scales: Float32Array, view: View) -> npt.NDArray[np.int64]:
    """Return the rows of the splats that a view may show, in order: a few that it doesn't are among them."""
    count = len(centers)
    marks = np.empty(count, np.bool_)
    run_shares(
        projection.mark_in_view, -(-count // projection.BLOCK), count,
        centers, log_scales, view.camera_from_world, view.intrinsics, marks,
    )  # fmt: skip
    return np.flatnonzero(marks)


def draw(splats: Splats, view: View, background: Float32Array, frames: Float32Array = NO_FRAMES) -> Drawing:
    """Project, colour, sort, bin and composite; `frames` turn the harmonics of splats that have moved."""
    count = len(splats.centers)
    screen = np.empty((count, projection.SCREEN_COLUMNS), np.float32)
    run_shares(
        projection.project, splats.block_count, count,
        *splats[:4], view.camera_from_world, view.intrinsics, view.antialiased, screen,
    )  # fmt: skip
    colours = splats.colours
    if colours.ndim == 3:
        colours = np.empty((count, 3), np.float32)
        run_shares(
            harmonics.paint, splats.block_count, count,
            splats.centers, splats.colours, view.viewpoint, frames, screen, colours,
        )  # fmt: skip
    lists = list_tiles(screen, view)
    image, transmittance, taken, processed = composite(lists, view, colours, background)
    return Drawing(image, transmittance, screen, colours, background, lists, taken, processed)


def list_tiles(screen: Float32Array, view: View) -> TileLists:
    """Sort the visible splats by depth and hand them to the tiles they touch."""
    rows, columns = view.tiles
    order = binning.depth_order(screen)
    drawn = len(order)
    ordered = np.empty((drawn, projection.SCREEN_COLUMNS), np.float32)
    run_shares(binning.gather, drawn, drawn, order, screen, ordered)
    strip_starts = binning.strip_starts(ordered, columns)
    strips = np.empty((strip_starts[-1], 2), np.int32)
    run_shares(binning.clip_strips, drawn, drawn, ordered, columns, view.size[0], strip_starts, strips)
    length = max(binning.SHORTEST_RUN, -(-drawn // binning.MOST_RUNS))
    runs = -(-drawn // length)
    counts, slot_counts = np.zeros((runs, rows * columns), np.int64), np.zeros(len(screen), np.int32)
    run_shares(
        binning.count_entries, runs, drawn, length, ordered, order, columns, strip_starts, strips, counts, slot_counts
    )  # fmt: skip
    starts = np.concatenate([[0], np.cumsum(counts.sum(axis=0))])
    first_slots = np.concatenate([[0], np.cumsum(counts.sum(axis=1))])
    first_entries = starts[:-1] + np.cumsum(counts, axis=0) - counts
    total = int(starts[-1])
    splats, reached, slots = np.empty(total, np.int32), np.empty((total, 2), np.uint8), np.empty(total, np.int32)
    slot_starts = np.zeros(len(screen), np.int32)
    run_shares(
        binning.fill_entries, runs, drawn,
        length, ordered, order, columns, strip_starts, strips, first_entries, first_slots,
        splats, reached, slots, slot_starts,
    )  # fmt: skip
    return TileLists(order, ordered, starts, splats, reached, slots, slot_starts, slot_counts)


def composite(
    lists: TileLists, view: View, paint: Float32Array, background: Float32Array = NO_BACKGROUND
) -> tuple[Float32Array, Float32Array, Float32Array, npt.NDArray[np.int64]]:
    """Return the image (3, height, width) of what splats show (splat, 3), transmittance, entries per pixel and tile."""
    image = np.empty((compositing.CHANNELS, *view.size), np.float32)
    transmittance, taken = np.empty(view.size, np.float32), np.empty(view.size, np.float32)
    processed = np.empty(len(lists.starts) - 1, np.int64)
    run_shares(
        compositing.composite, len(processed), view.pixel_count,
        view.tiles[1], lists.screen, np.take(paint, lists.order, axis=0), lists.starts, lists.splats, lists.rows,
        background, image, transmittance, taken, processed,
    )  # fmt: skip
    return image, transmittance, taken, processed


def composite_backward(
    drawing: Drawing, view: View, paint: Float32Array, background: Float32Array,
    d_image: Float32Array, d_transmittance: Float32Array,
) -> Float32Array:  # fmt: skip
    """Return the moments (slot, MOMENT_COLUMNS) of the image of `paint` over `background`, drawn as the drawing was."""
    lists = drawing.lists
    moments = np.empty((len(lists.splats), compositing.MOMENT_COLUMNS), np.float32)
    run_shares(
        compositing.composite_backward, len(drawing.processed), view.pixel_count,
        view.tiles[1], lists.screen, np.take(paint, lists.order, axis=0), lists.starts, lists.splats, lists.rows,
        lists.slots, drawing.processed, background, drawing.transmittance, drawing.taken, d_image, d_transmittance,
        moments,
    )  # fmt: skip
    return moments


def median_splats(drawing: Drawing, view: View) -> Int32Array:
    """Return the index of the splat behind which less than half of a pixel's light is left (height, width), or -1."""
    median = np.empty(view.size, np.int32)
    lists = drawing.lists
    run_shares(
        compositing.find_median, len(drawing.processed), view.pixel_count,
        view.tiles[1], lists.screen, lists.starts, lists.splats, lists.rows, drawing.processed, median,
    )  # fmt: skip
    return np.where(median >= 0, lists.order[median], -1) if len(lists.order) else median


def sum_features(drawing: Drawing, moments: Float32Array) -> Float32Array:
    """Return the gradient of what splats show (splat, 3)."""
    lists = drawing.lists
    count = len(lists.slot_starts)
    gradient = np.empty((count, compositing.CHANNELS), np.float32)
    run_shares(compositing.sum_paint, count, count, lists.slot_starts, lists.slot_counts, moments, gradient)
    return gradient


def splats_backward(
    splats: Splats, view: View, drawing: Drawing, moments: Float32Array, frames: Float32Array = NO_FRAMES
) -> DrawingGradient:
    """Carry moments back to the splats and the pose."""
    count, lists = len(splats.centers), drawing.lists
    gradient = Splats(*(np.empty_like(array) for array in splats))
    d_colours = gradient.colours if splats.colours.ndim == 2 else np.empty((count, 3), np.float32)
    d_means = np.empty((count, 2), np.float32)
    d_poses = np.empty((splats.block_count, 3, 4))
    run_shares(
        projection_gradient.project_backward, splats.block_count, count,
        *splats[:4], view.camera_from_world, view.intrinsics, view.antialiased, drawing.screen,
        lists.slot_starts, lists.slot_counts, moments,
        *gradient[:4], d_colours, d_means, d_poses,
    )  # fmt: skip
    d_pose = d_poses.sum(axis=0)
    if splats.colours.ndim == 3:
        d_viewpoints = np.empty((splats.block_count, 3))
        run_shares(
            harmonics.paint_backward, splats.block_count, count,
            splats.centers, splats.colours, view.viewpoint, frames, drawing.colours, lists.slot_counts, d_colours,
            gradient.colours, gradient.centers, d_viewpoints,
        )  # fmt: skip
        # the viewpoint is -R^T t
        d_viewpoint = d_viewpoints.sum(axis=0)
        d_pose[:, :3] -= np.outer(view.camera_from_world[:, 3], d_viewpoint)
        d_pose[:, 3] -= view.camera_from_world[:, :3] @ d_viewpoint
    return DrawingGradient(gradient, d_pose, d_means)
