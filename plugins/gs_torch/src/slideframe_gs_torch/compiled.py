"""The order in which the compiled kernels draw one view, on NumPy arrays."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array, Int32Array
from slideframe.products import Camera
from slideframe_gs_torch import binning_kernels as binning
from slideframe_gs_torch import compositing_kernels as compositing
from slideframe_gs_torch import projection_kernels as projection
from slideframe_gs_torch.threads import run_shares


@dataclass(frozen=True)
class View:
    """What the kernels know of the camera: (3, 4) and (fx, fy, cx, cy, width, height)."""

    camera_from_world: Float64Array
    intrinsics: Float64Array

    @classmethod
    def of(cls, camera: Camera, camera_from_world: Float64Array) -> Self:
        """Flatten a camera."""
        intrinsics = (
            camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y, camera.width, camera.height
        )  # fmt: skip
        return cls(np.ascontiguousarray(camera_from_world), np.array(intrinsics, np.float64))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, px."""
        return int(self.intrinsics[5]), int(self.intrinsics[4])

    @property
    def pixel_count(self) -> int:
        """Number of pixels."""
        return self.size[0] * self.size[1]


class Splats(NamedTuple):
    """What is drawn, or its gradient: see `rasterize`."""

    centers: Float32Array
    rotations: Float32Array
    scales: Float32Array
    opacities: Float32Array
    colours: Float32Array


@dataclass(frozen=True)
class Drawing:
    """A drawn view and what its gradient needs."""

    planes: Float32Array
    transmittance: Float32Array
    screen: Float32Array
    slot_starts: npt.NDArray[np.int64]
    slot_counts: Int32Array
    slot_splats: Int32Array
    slots: Int32Array
    tile_starts: npt.NDArray[np.int64]
    processed: npt.NDArray[np.int64]


def draw(splats: Splats, view: View) -> Drawing:
    """Project, sort, bin and composite; `planes` are red, green, blue and depth without background."""
    height, width = view.size
    columns, rows = -(-width // binning.TILE), -(-height // binning.TILE)
    screen = np.empty((len(splats.centers), projection.SCREEN_COLUMNS), np.float32)
    count = len(splats.centers)
    run_shares(projection.project, count, count, *splats, view.camera_from_world, view.intrinsics, screen)
    order = binning.depth_order(screen)
    counts = np.zeros(len(splats.centers), np.int32)
    binning.count_tiles(screen, order, columns, rows, counts)
    starts, total = binning.slot_starts(order, counts)
    slot_splats, slot_tiles = np.empty(total, np.int32), np.empty(total, np.int32)
    binning.list_tiles(screen, order, columns, rows, starts, slot_splats, slot_tiles)
    slots, tile_starts = binning.tile_lists(slot_tiles, columns * rows)
    planes = np.empty((compositing.CHANNELS, height, width), np.float32)
    transmittance = np.empty((height, width), np.float32)
    processed = np.empty(columns * rows, np.int64)
    run_shares(
        compositing.composite, columns * rows, width * height,
        screen, slots, slot_splats, tile_starts, columns, planes, transmittance, processed,
    )  # fmt: skip
    return Drawing(planes, transmittance, screen, starts, counts, slot_splats, slots, tile_starts, processed)


def draw_backward(
    splats: Splats, view: View, drawing: Drawing, d_planes: Float32Array, d_transmittance: Float32Array
) -> tuple[Splats, Float32Array]:
    """Return the gradients of the splats and the screen gradients (splat, 2)."""
    columns = -(-view.size[1] // binning.TILE)
    moments = np.empty((len(drawing.slot_splats), projection.MOMENT_COLUMNS), np.float32)
    run_shares(
        compositing.composite_backward, len(drawing.processed), view.pixel_count,
        drawing.screen, drawing.slots, drawing.slot_splats, drawing.tile_starts, columns, drawing.processed,
        drawing.planes, drawing.transmittance, d_planes, d_transmittance, moments,
    )  # fmt: skip
    gradients = Splats(*(np.empty_like(array) for array in splats))
    d_means = np.empty((len(splats.centers), 2), np.float32)
    count = len(splats.centers)
    run_shares(
        projection.project_backward, count, count,
        splats.centers, splats.rotations, splats.scales, view.camera_from_world, view.intrinsics, drawing.screen,
        drawing.slot_starts, drawing.slot_counts, moments, *gradients, d_means,
    )  # fmt: skip
    return gradients, d_means
