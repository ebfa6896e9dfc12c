"""The shape of the demo's ground: a steep slope above a road, with gullies, benches, rock, boulders and shrubs.

Coordinates are metres in the site's frame: x east, y north, z above the road.
"""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.demo.grid import GroundGrid
from slideframe.demo.noise import fractal_noise, ridges, smooth_noise, step

SLOPE_TANGENT = 0.78  # 38 degrees
UPLAND_TANGENT = 0.14
TOE = 7.0  # distance from the road's axis to the foot of the slope, m
CREST = 46.0
ROAD_HALF_WIDTH = 3.6
SHRUB_COUNT = 5200
BOULDER_COUNT = 700


@dataclass(frozen=True)
class Terrain:
    """Heights on a grid, and what covers them.

    Attributes:
        grid: where the samples lie.
        heights: upper surface with shrubs and boulders (row, column), m.
        shrubs: height of leaves above the ground (row, column), m.
        boulders: height of loose rock above the ground (row, column), m.
        rock: share of outcropping rock (row, column).
        scar: share of bare soil of the old slide (row, column).
    """

    grid: GroundGrid
    heights: Float32Array
    shrubs: Float32Array
    boulders: Float32Array
    rock: Float32Array
    scar: Float32Array


def road_distance(x: Float64Array, y: Float64Array) -> Float32Array:
    """Return how far north of the road's axis the grid's points lie (row, column), m."""
    axis = -30 + 3 * np.sin(2 * np.pi * x / 260 + 0.6)
    distance: Float32Array = (y[:, None] - axis).astype(np.float32)
    return distance


def make_terrain(grid: GroundGrid) -> Terrain:
    """Build the ground; the same ground whatever the grid, but for detail finer than its cells."""
    x = y = grid.axis
    distance = road_distance(x, y)
    on_slope = step(distance, TOE - 1, TOE + 6)
    rock = _rock_share(x, y, distance)
    scar = scar_share(x, y)
    heights = _profile(distance)
    heights += (
        np.float32(0.55) * on_slope * np.sin(heights * np.float32(2 * np.pi / 9) + 2 * smooth_noise(x, y, 20.0, 11))
    )
    heights += on_slope * (_gullies(x, y) * (1 - step(distance, CREST - 4, CREST + 14) * np.float32(0.7)))
    heights += _roughness(x, y, distance, on_slope)
    heights += rock * (
        ridges(smooth_noise(x, y, 4.5, 31)) * np.float32(1.1) + ridges(smooth_noise(x, y, 1.7, 32)) * np.float32(0.4)
    )
    heights -= scar * on_slope * np.float32(1.1)
    ground = heights.copy()
    shrubs = _scatter_shrubs(grid, heights, ground, distance, scar)
    boulders = _scatter_boulders(grid, heights, ground, distance)
    return Terrain(grid, heights, shrubs, boulders, rock, scar)


def scar_share(x: Float64Array, y: Float64Array) -> Float32Array:
    """Return 1 inside the bare scar of an old, shallow slide on the slope, 0 outside (row, column)."""
    ragged = fractal_noise(x, y, (9.0, 4.5, 2.2, 1.1, 0.5), 61)
    across = (x - 1.5 - 0.12 * (y[:, None] + 5)) / (7.5 + 0.13 * (8 - y[:, None]))
    along = (y[:, None] + 5) / 15.5
    radius = np.sqrt(across**2 + along**2).astype(np.float32) + np.float32(0.16) * ragged
    return 1 - step(radius, 0.86, 1.06)


def _softplus(value: Float32Array, width: float) -> Float32Array:
    rounded: Float32Array = np.float32(width) * np.logaddexp(0, value / np.float32(width))
    return rounded


def _profile(distance: Float32Array) -> Float32Array:
    """Cross-section of road, slope and upland; the meadow beyond the road falls away gently."""
    rise = np.float32(SLOPE_TANGENT) * _softplus(distance - TOE, 0.6)
    bend = np.float32(SLOPE_TANGENT - UPLAND_TANGENT) * _softplus(distance - CREST, 2.2)
    fall = np.float32(0.06) * _softplus(-distance - 18, 3.0)
    crown = np.float32(-0.02) * np.minimum(np.abs(distance), ROAD_HALF_WIDTH)
    drain = np.float32(-0.22) * (step(distance, 3.75, 3.9) - step(distance, 4.3, 4.5))
    heights: Float32Array = rise - bend - fall + crown + drain
    return heights


def _gullies(x: Float64Array, y: Float64Array) -> Float32Array:
    """Channels that run down the slope, m (negative)."""
    deep = ridges(1.4 * smooth_noise(x, y, (9.0, 34.0), 21) + 0.25 * smooth_noise(x, y, 5.0, 22))
    shallow = ridges(1.6 * smooth_noise(x, y, (3.6, 12.0), 23))
    return np.float32(-1.9) * deep - np.float32(0.55) * shallow


def _roughness(x: Float64Array, y: Float64Array, distance: Float32Array, on_slope: Float32Array) -> Float32Array:
    """Hummocks at every scale; none on the road."""
    hummocks = fractal_noise(x, y, (14.0, 7.0, 3.5, 1.75, 0.9, 0.45), 41, roughness=0.52)
    beside_road = step(np.abs(distance), ROAD_HALF_WIDTH + 0.9, ROAD_HALF_WIDTH + 5)
    hills = smooth_noise(x, y, 60.0, 51) * step(np.abs(distance), 30, 120)
    return beside_road * (np.float32(0.22) + np.float32(0.68) * on_slope) * hummocks + np.float32(7) * hills


def _rock_share(x: Float64Array, y: Float64Array, distance: Float32Array) -> Float32Array:
    patches = fractal_noise(x, y, (13.0, 6.0, 2.6, 1.2, 0.5), 71)
    height_on_slope = step(distance, TOE + 4, TOE + 22) * (1 - step(distance, CREST - 2, CREST + 8))
    return step(patches, 0.52, 0.66) * height_on_slope


def _scatter_shrubs(
    grid: GroundGrid, heights: Float32Array, ground: Float32Array, distance: Float32Array, scar: Float32Array
) -> Float32Array:
    """Raise domes of leaves in thickets, off the road and the scar, and return their cover."""
    generator = np.random.Generator(np.random.PCG64(81))
    axis = grid.axis
    half = 0.98 * axis[-1]
    thickets = fractal_noise(axis, axis, (24.0, 11.0, 5.0), 82)
    lumps = 1 + 0.5 * fractal_noise(axis, axis, (1.1, 0.6, 0.34), 85, roughness=0.8)
    cover = np.zeros_like(heights)
    # every shrub draws the same numbers whether it stands or not, so that all grids grow the same shrubs
    for x, y, size, chance in generator.random((4 * SHRUB_COUNT, 4)):
        row, column = _nearest(grid, half * (2 * y - 1)), _nearest(grid, half * (2 * x - 1))
        density = 0.25 + 0.55 * thickets[row, column] - 1.5 * scar[row, column] - 9 * (abs(distance[row, column]) < 7.5)
        if chance < density:
            radius = 0.55 + 1.35 * size**3
            _raise_dome(grid, heights, ground, cover, (row, column), radius, radius * 0.8, lumps)
    return cover


def _scatter_boulders(
    grid: GroundGrid, heights: Float32Array, ground: Float32Array, distance: Float32Array
) -> Float32Array:
    """Drop boulders on the slope, most of them near its foot, and return their cover."""
    generator = np.random.Generator(np.random.PCG64(91))
    axis = grid.axis
    facets = 1 + 0.22 * fractal_noise(axis, axis, (0.7, 0.35), 95)
    cover = np.zeros_like(heights)
    for x, y, size, chance in generator.random((BOULDER_COUNT, 4)):
        row, column = _nearest(grid, 60 * y - 24), _nearest(grid, 150 * (x - 0.5))
        north = distance[row, column]
        if chance < np.clip(1.1 - (north - TOE) / 50, 0, 1) * (north > TOE - 1.5):
            radius = min(0.28 / (1 - 0.97 * size) ** 0.5, 1.5)
            _raise_dome(grid, heights, ground, cover, (row, column), radius, 0.7 * radius, facets)
    return cover


def _nearest(grid: GroundGrid, coordinate: float) -> int:
    return int(np.clip(round((coordinate - grid.start) / grid.spacing), 0, grid.count - 1))


def _raise_dome(
    grid: GroundGrid,
    heights: Float32Array,
    ground: Float32Array,
    cover: Float32Array,
    centre: tuple[int, int],
    radius: float,
    height: float,
    lumps: Float32Array,
) -> None:
    """Put a lumpy half ellipsoid on the ground, in place."""
    reach = int(radius * 1.3 / grid.spacing) + 1
    rows = slice(max(centre[0] - reach, 0), centre[0] + reach + 1)
    columns = slice(max(centre[1] - reach, 0), centre[1] + reach + 1)
    north = (np.arange(grid.count)[rows] - centre[0]) * (grid.spacing / radius)
    east = (np.arange(grid.count)[columns] - centre[1]) * (grid.spacing / radius)
    inside = np.maximum(lumps[rows, columns] - (north[:, None] ** 2 + east**2), 0).astype(np.float32)
    dome = np.float32(height) * np.sqrt(inside)
    heights[rows, columns] = np.maximum(heights[rows, columns], ground[rows, columns] + dome)
    cover[rows, columns] = np.maximum(cover[rows, columns], dome)
