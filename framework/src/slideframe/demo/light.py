"""Sunlight, cast shadows and skylight on the demo's ground, all diffuse: the same from every camera."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array
from slideframe.demo.grid import GroundGrid

SUN_AZIMUTH = 131.0  # degrees from north: a morning in autumn
SUN_ELEVATION = 44.0
SUN_COLOR = np.array([2.55, 2.35, 2.02], np.float32)[:, None, None]
SKY_COLOR = np.array([0.36, 0.44, 0.58], np.float32)[:, None, None]
PENUMBRA = (
    0.05  # width of the shadow's edge per metre behind what casts it; the true sun's 0.009 would alias on the grid
)


@dataclass(frozen=True)
class Light:
    """What falls on each sample of the ground.

    Attributes:
        sun: cosine of the angle between ground and sun, 0 in shadow (row, column).
        sky: share of the sky that the sample sees (row, column).
    """

    sun: Float32Array
    sky: Float32Array

    def irradiance(self, sun: Float32Array, sky: Float32Array) -> Float32Array:
        """Return the colour of the light (3, row, column) for interpolated `sun` and `sky`."""
        return sun * SUN_COLOR + sky * SKY_COLOR


def sun_direction() -> tuple[float, float, float]:
    """Return the unit vector towards the sun, east, north, up."""
    azimuth, elevation = np.radians(SUN_AZIMUTH), np.radians(SUN_ELEVATION)
    horizontal = np.cos(elevation)
    return float(np.sin(azimuth) * horizontal), float(np.cos(azimuth) * horizontal), float(np.sin(elevation))


def illuminate(grid: GroundGrid, heights: Float32Array) -> Light:
    """Light the ground."""
    slope_north, slope_east = np.gradient(heights, np.float32(grid.spacing))
    length = np.sqrt(1 + slope_east**2 + slope_north**2)
    east, north, up = (np.float32(component) for component in sun_direction())
    cosine = np.maximum((up - east * slope_east - north * slope_north) / length, 0)
    sky = (0.5 + 0.5 / length) * np.clip(1 + 0.55 * _openness(grid, heights), 0.3, 1.15)
    return Light(sun=(cosine * _sunlit(grid, heights)).astype(np.float32), sky=sky.astype(np.float32))


def _sunlit(grid: GroundGrid, heights: Float32Array) -> Float32Array:
    """Return 0 in shadow, 1 in the sun: walk towards the sun and keep the narrowest clearance."""
    east, north, up = sun_direction()
    horizontal = float(np.hypot(east, north))
    lit = np.ones_like(heights)
    for distance in np.geomspace(1.4 * grid.spacing, 16.0, 22):
        shift_east, shift_north = distance * east / horizontal, distance * north / horizontal
        occluder = grid.resample(heights, grid.axis + shift_east, grid.axis + shift_north)
        clearance = heights + np.float32(distance * up / horizontal) - occluder
        np.minimum(lit, np.clip(clearance / np.float32(PENUMBRA * distance + 0.06), 0, 1), out=lit)
    return lit


def _openness(grid: GroundGrid, heights: Float32Array) -> Float32Array:
    """Return how far the ground stands above (positive) or in a hollow of its surroundings, m."""
    near, far = (_box_blur(heights, max(int(radius / grid.spacing), 1)) for radius in (0.6, 1.8))
    return (2 * heights - near - far) / np.float32(1.2)


def _box_blur(field: Float32Array, radius: int) -> Float32Array:
    """Average over a square of 2 radius + 1 samples, the edge repeated."""
    for axis in (0, 1):
        padded = np.pad(field, [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        total = np.cumsum(padded, axis=axis, dtype=np.float64)
        width = 2 * radius + 1
        high, low = (total[width:], total[:-width]) if axis == 0 else (total[:, width:], total[:, :-width])
        field = ((high - low) / width).astype(np.float32)
    return field
