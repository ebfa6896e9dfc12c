"""Rays from a camera to the ground, and the photograph that they make."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.demo.appearance import Appearance
from slideframe.demo.grid import GroundGrid
from slideframe.products import Camera

ENVELOPE_CELLS = 8
PROBE_STRIDE = 8  # px between the rays that look for a safe start
STRIP_ROWS = 64
WHOLE_STEPS = 16
SURFACE_TOLERANCE = 2e-3  # m; a fifteenth of the finest texel


@dataclass(frozen=True)
class Ground:
    """Heights, and a coarse lid that nothing sticks out of.

    Attributes:
        grid: where the heights lie.
        heights: (row, column), m.
        lid_grid: a coarser grid.
        lid: highest ground within two of its cells (row, column), m.
    """

    grid: GroundGrid
    heights: Float32Array
    lid_grid: GroundGrid
    lid: Float32Array

    def cast(self, origin: Float64Array, rays: Float32Array) -> Float32Array:
        """Return how far along each ray (row, column, 3) the ground is met (row, column), in lengths of the ray."""
        start = self._safe_start(origin, rays)
        found = [
            self._meet(
                origin, rays[first : first + STRIP_ROWS].reshape(-1, 3), start[first : first + STRIP_ROWS].ravel()
            )
            for first in range(0, len(rays), STRIP_ROWS)
        ]
        return np.concatenate(found).reshape(start.shape)

    def _safe_start(self, origin: Float64Array, rays: Float32Array) -> Float32Array:
        """March a few rays down to the lid, and give every ray the nearest of its neighbours' ends."""
        rows = np.unique([*range(0, len(rays), PROBE_STRIDE), len(rays) - 1])
        columns = np.unique([*range(0, rays.shape[1], PROBE_STRIDE), rays.shape[1] - 1])
        probes = rays[np.ix_(rows, columns)].reshape(-1, 3)
        reach = ((self.lid.max() - origin[2]) / probes[:, 2]).astype(np.float32)
        stride = np.float32(self.lid_grid.spacing) / np.hypot(probes[:, 0], probes[:, 1]).clip(0.25)
        moving = np.arange(len(probes))
        while moving.size:
            x, y, z = (origin[axis] + reach[moving] * probes[moving, axis] for axis in range(3))
            moving = moving[z > self.lid_grid.lookup(self.lid, x, y)]
            reach[moving] += stride[moving]
        reach = (reach - stride).reshape(len(rows), len(columns))
        padded = np.pad(reach, 1, mode="edge")
        nearest = np.min([padded[i : i + len(rows), j : j + len(columns)] for i in range(3) for j in range(3)], axis=0)
        row_of = np.searchsorted(rows, np.arange(len(rays)), side="right") - 1
        column_of = np.searchsorted(columns, np.arange(rays.shape[1]), side="right") - 1
        safe: Float32Array = np.maximum(nearest[np.ix_(row_of, column_of)], 0)
        return safe

    def _meet(self, origin: Float64Array, rays: Float32Array, start: Float32Array) -> Float32Array:
        """Close the gap between ray and ground by steps of gap / (closing speed over ground rising at 45 degrees).

        The step falls short over gentler ground, so the nearest surface is met first; below the surface
        it turns back. Before ground three times as steep it would swing for ever: late steps are halved,
        which ends on ground up to seven times as steep. Rays within the tolerance rest.
        """
        speed = np.hypot(rays[:, 0], rays[:, 1]) - rays[:, 2]
        reach, moving = start.copy(), np.arange(len(rays))
        for turn in range(40):
            x, y, z = (np.float32(origin[axis]) + reach[moving] * rays[moving, axis] for axis in range(3))
            gap = z - self.grid.lookup(self.heights, x, y)
            reach[moving] += (1.0 if turn < WHOLE_STEPS else 0.5) * gap / speed[moving]
            if turn % 4 == 3:
                moving = moving[np.abs(gap) > SURFACE_TOLERANCE]
        return reach


def make_ground(grid: GroundGrid, heights: Float32Array) -> Ground:
    """Build the lid over the heights."""
    count = grid.count // ENVELOPE_CELLS
    blocks = heights[: count * ENVELOPE_CELLS, : count * ENVELOPE_CELLS]
    lid = blocks.reshape(count, ENVELOPE_CELLS, count, ENVELOPE_CELLS).max(axis=(1, 3))
    padded = np.pad(lid, 2, mode="edge")
    lid = np.max([padded[i : i + count, j : j + count] for i in range(5) for j in range(5)], axis=0)
    return Ground(grid, heights, GroundGrid(grid.spacing * ENVELOPE_CELLS, count), lid)


def photograph(
    ground: Ground,
    appearance: Appearance,
    camera: Camera,
    rays: Float32Array,
    world_from_camera: Float64Array,
    *,
    seed: int,
) -> UInt8Array:
    """Expose one picture (row, column, 3), sRGB, with the noise of its sensor."""
    position = world_from_camera[:, 3]
    directions = rays @ world_from_camera[:, :3].T.astype(np.float32)
    reach = ground.cast(position, directions)
    picture = np.empty((camera.height, camera.width, 3), np.uint8)
    generator = np.random.default_rng(seed)
    for first in range(0, camera.height, STRIP_ROWS):
        rows = slice(first, first + STRIP_ROWS)
        distance, direction = reach[rows].ravel(), directions[rows].reshape(-1, 3)
        x, y = (np.float32(position[axis]) + distance * direction[:, axis] for axis in (0, 1))
        colors = appearance.colors(x, y, distance / np.float32(camera.focal_x))
        colors += generator.normal(0, 1.6, colors.shape[1]) + generator.normal(0, 0.8, colors.shape)
        picture[rows] = np.clip(np.round(colors), 0, 255).astype(np.uint8).T.reshape(-1, camera.width, 3)
    return picture
