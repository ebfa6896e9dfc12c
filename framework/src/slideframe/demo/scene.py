"""The demo's place, built to the detail that a picture's width can show."""

import math
import os
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.demo.appearance import Appearance, make_appearance
from slideframe.demo.cover import paint_ground
from slideframe.demo.flight import FLIGHT_MEAN
from slideframe.demo.grid import GroundGrid
from slideframe.demo.lens import pixel_rays
from slideframe.demo.light import illuminate
from slideframe.demo.raycast import Ground, make_ground, photograph
from slideframe.demo.terrain import Terrain, make_terrain
from slideframe.products import Camera

DOMAIN = 384.0  # side of the modelled ground, m
MIDDLE = 179.2  # side of its finely painted middle, m
FINEST_TEXEL = 0.032  # m
FINEST_CELL = 0.16  # m
TRUTH_REACH = 80.0  # half the side of the square whose heights are kept as ground truth, m


@dataclass(frozen=True)
class Scene:
    """Ground, light and colours, ready for cameras. Poses are in the survey's frame."""

    terrain: Terrain
    ground: Ground
    appearance: Appearance

    def photograph(
        self, camera: Camera, rays: Float32Array, world_from_camera: Float64Array, *, seed: int
    ) -> UInt8Array:
        """Expose one picture (row, column, 3), sRGB."""
        pose = world_from_camera.copy()
        pose[:, 3] += FLIGHT_MEAN
        return photograph(self.ground, self.appearance, camera, rays, pose, seed=seed)

    def depths(self, camera: Camera, world_from_camera: Float64Array) -> Float32Array:
        """Return the distance along the optical axis to what each pixel shows (row, column), m."""
        rays = pixel_rays(camera) @ world_from_camera[:, :3].T.astype(np.float32)
        return self.ground.cast(world_from_camera[:, 3] + FLIGHT_MEAN, rays)

    def ground_truth(self) -> dict[str, np.ndarray]:
        """Return the middle's surface and reflectance in the survey's frame.

        `x` (column,), `y` (row,) and `heights` (row, column) are float64, float64 and float32 metres; the
        heights are those of the upper surface, plants and boulders included. `reflectance`
        (3, row, column), float16, is linear.
        """
        grid = self.terrain.grid
        inside = np.flatnonzero(np.abs(grid.axis) <= TRUTH_REACH)
        axis, square = grid.axis[inside], np.ix_(inside, inside)
        return {
            "x": axis - FLIGHT_MEAN[0],
            "y": axis - FLIGHT_MEAN[1],
            "heights": self.terrain.heights[square] - np.float32(FLIGHT_MEAN[2]),
            "reflectance": paint_ground(axis, axis, self.terrain).astype(np.float16),
        }


def build_scene(width: int) -> Scene:
    """Build the place for pictures `width` pixels wide: narrow pictures get coarser ground."""
    coarsening = 2 ** math.ceil(math.log2(max(min(960 / width, 8), 1)))
    texel, cell = FINEST_TEXEL * coarsening, FINEST_CELL * min(coarsening, 2)
    terrain = make_terrain(GroundGrid(cell, round(DOMAIN / cell)))
    light = illuminate(terrain.grid, terrain.heights)
    appearance = make_appearance(terrain, light, texel, round(MIDDLE / texel), worker_count())
    return Scene(terrain, make_ground(terrain.grid, terrain.heights), appearance)


def worker_count() -> int:
    """Return how many threads to use; the result doesn't depend on it."""
    return min(os.cpu_count() or 1, 8)
