"""The lit ground as a picture pyramid, fine where the drone flies and coarse in the surroundings."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.demo.cover import paint_ground
from slideframe.demo.grid import GroundGrid
from slideframe.demo.light import Light
from slideframe.demo.noise import fractal_noise
from slideframe.demo.terrain import Terrain

STRIP_ROWS = 96
FINE_LEVELS = 2  # levels that cover the middle only; coarser ones cover everything
EXPOSURE = 0.92


@dataclass(frozen=True)
class Appearance:
    """What a camera sees of the ground, in sRGB.

    Attributes:
        grids: where the texels of each level lie, spacing doubling from level to level.
        levels: colours of each level, channel first (3, row, column).
    """

    grids: tuple[GroundGrid, ...]
    levels: tuple[UInt8Array, ...]

    def colors(self, x: Float32Array, y: Float32Array, footprint: Float32Array) -> Float32Array:
        """Return the colours (3, point), 0 to 255, of points whose pixel covers `footprint` metres."""
        level = np.clip(np.round(np.log2(footprint / self.grids[0].spacing)), 0, len(self.grids) - 1).astype(np.int32)
        reach = np.maximum(np.abs(x), np.abs(y))
        level[(level < FINE_LEVELS) & (reach > -self.grids[0].start)] = min(FINE_LEVELS, len(self.grids) - 1)
        colors = np.empty((3, len(x)), np.float32)
        for index in np.unique(level):
            chosen = np.flatnonzero(level == index)
            for channel in range(3):
                field = self.levels[index][channel]
                colors[channel, chosen] = self.grids[index].lookup(field, x[chosen], y[chosen])
        return colors


def make_appearance(terrain: Terrain, light: Light, texel: float, count: int, workers: int) -> Appearance:
    """Paint and light the ground with `count` texels of `texel` metres along a side of the middle.

    The surroundings reach as far as the terrain does, with texels 2**FINE_LEVELS times as large.
    """
    fine = GroundGrid(texel, count)
    coarse_spacing = texel * 2**FINE_LEVELS
    margin = int((terrain.grid.count * terrain.grid.spacing / coarse_spacing - count / 2**FINE_LEVELS) / 2)
    coarse = GroundGrid(coarse_spacing, count // 2**FINE_LEVELS + 2 * margin)
    grids, levels = [fine], [_photograph_ground(fine, terrain, light, workers)]
    for _ in range(FINE_LEVELS - 1):
        grids.append(GroundGrid(2 * grids[-1].spacing, grids[-1].count // 2))
        levels.append(_halve(levels[-1]))
    around = _photograph_ground(coarse, terrain, light, workers)
    inside = slice(margin, margin + count // 2**FINE_LEVELS)
    around[:, inside, inside] = _halve(levels[-1])
    for _ in range(3):
        grids.append(coarse)
        levels.append(around)
        around = _halve(around[:, : coarse.count // 2 * 2, : coarse.count // 2 * 2])
        coarse = GroundGrid(2 * coarse.spacing, coarse.count // 2)
    return Appearance(tuple(grids), tuple(levels))


def encode_srgb(linear: Float32Array) -> UInt8Array:
    """Encode linear light (0 to 1) as sRGB (IEC 61966-2-1)."""
    table_size = 4096
    ramp = np.arange(table_size) / (table_size - 1)
    encoded = np.where(ramp <= 0.0031308, 12.92 * ramp, 1.055 * ramp ** (1 / 2.4) - 0.055)
    table = np.round(255 * encoded).astype(np.uint8)
    return table[np.clip(linear * (table_size - 1), 0, table_size - 1).astype(np.int32)]


def _photograph_ground(grid: GroundGrid, terrain: Terrain, light: Light, workers: int) -> UInt8Array:
    """Fill one level, strip by strip, so that intermediate arrays stay small."""
    level = np.empty((3, grid.count, grid.count), np.uint8)

    def paint(first: int) -> None:
        rows = slice(first, first + STRIP_ROWS)
        level[:, rows] = _lit_strip(grid.axis, grid.axis[rows], terrain, light)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(paint, range(0, grid.count, STRIP_ROWS)))
    return level


def _lit_strip(x: Float64Array, y: Float64Array, terrain: Terrain, light: Light) -> UInt8Array:
    """Return sRGB colours (3, row, column); fine relief below the terrain's cells is embossed on the sunlight."""
    color = paint_ground(x, y, terrain)
    sun = terrain.grid.resample(light.sun, x, y)
    sky = terrain.grid.resample(light.sky, x, y)
    relief = fractal_noise(x, y, (0.34, 0.17, 0.085, 0.065), 201, roughness=0.75)
    sun *= np.clip(1 + np.float32(0.42) * (np.roll(relief, -1, axis=1) - np.roll(relief, 1, axis=1)), 0.45, 1.6)
    color *= light.irradiance(sun, sky) * np.float32(EXPOSURE)
    # a shoulder like a camera's: linear in the dark, never above white
    color *= 1 / (1 + np.float32(0.42) * color)
    return encode_srgb(color)


def _halve(level: UInt8Array) -> UInt8Array:
    """Average 2 x 2 texels, rounding to nearest."""
    wide = level.astype(np.uint16)
    return ((wide[:, ::2, ::2] + wide[:, 1::2, ::2] + wide[:, ::2, 1::2] + wide[:, 1::2, 1::2] + 2) // 4).astype(
        np.uint8
    )
