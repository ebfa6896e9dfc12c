"""The colours of the demo's ground: grass, bare soil, rock, boulders, shrubs and a road with its markings.

Every function takes the columns' x and the rows' y and returns linear reflectances (3, row, column).
"""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.demo.noise import fractal_noise, ridges, smooth_noise, speckle, step
from slideframe.demo.terrain import CREST, TOE, Terrain, road_distance

Color = tuple[float, float, float]

ASPHALT: Color = (0.085, 0.087, 0.090)
CONCRETE: Color = (0.36, 0.35, 0.32)
PAINT: Color = (0.78, 0.78, 0.74)
YELLOW_PAINT: Color = (0.72, 0.50, 0.07)


def paint_ground(x: Float64Array, y: Float64Array, terrain: Terrain) -> Float32Array:
    """Return the reflectance of everything that the terrain carries."""
    distance = road_distance(x, y)
    grain: Float32Array = fractal_noise(x, y, (0.42, 0.21, 0.105, 0.065), 101, roughness=0.85) + np.float32(
        0.45
    ) * speckle(x, y, 109)
    rock, scar, shrubs, boulders = (
        terrain.grid.resample(field, x, y) for field in (terrain.rock, terrain.scar, terrain.shrubs, terrain.boulders)
    )
    color, granite = _grass(x, y, grain), _rock(x, y, grain)
    bare = np.maximum(_worn_patches(x, y, distance, grain), step(scar + np.float32(0.12) * grain, 0.42, 0.58))
    _cover(color, _soil(x, y, grain), bare)
    _cover(color, granite, step(rock + np.float32(0.25) * grain, 0.45, 0.6))
    road = _road_share(distance, grain)
    if road.any():
        _cover(color, _road(x, y, distance, grain), road)
    _cover(color, granite * np.float32(1.12), step(boulders * (1 + np.float32(0.3) * grain), 0.04, 0.12))
    _cover(color, _leaves(x, y, grain, shrubs), step(shrubs * (1 + np.float32(0.7) * grain), 0.10, 0.30))
    return np.clip(color, 0.012, 0.9, out=color)


def _cover(below: Float32Array, above: Float32Array, share: Float32Array) -> None:
    """Lay one colour over another, in place."""
    below += share * (above - below)


def _mix(first: Color, second: Color, share: Float32Array) -> Float32Array:
    low, high = _channels(first), _channels(second)
    return low + share * (high - low)


def _channels(color: Color) -> Float32Array:
    return np.asarray(color, np.float32)[:, None, None]


def _grass(x: Float64Array, y: Float64Array, grain: Float32Array) -> Float32Array:
    dry = fractal_noise(x, y, (17.0, 6.0, 2.4, 1.0, 0.5), 111, roughness=0.65)
    color = _mix((0.085, 0.118, 0.038), (0.265, 0.232, 0.122), step(dry + 0.35 * grain, -0.55, 0.95))
    tufts = np.exp(np.float32(0.36) * grain + np.float32(0.22) * fractal_noise(x, y, (1.6, 0.8), 121))
    return color * tufts


def _soil(x: Float64Array, y: Float64Array, grain: Float32Array) -> Float32Array:
    """Decomposed granite: reddish brown with pale streaks down the slope, and stones."""
    wet = fractal_noise(x, y, (7.0, 3.0, 1.3, 0.6), 131, roughness=0.6)
    streaks = smooth_noise(x, y, (0.7, 5.0), 136) + smooth_noise(x, y, (0.3, 2.2), 137)
    color = _mix((0.205, 0.118, 0.068), (0.43, 0.315, 0.205), step(wet + 0.5 * streaks, -0.9, 1.1))
    color *= np.exp(np.float32(0.26) * grain)
    stones = smooth_noise(x, y, 0.20, 139) + np.float32(0.35) * smooth_noise(x, y, 1.6, 138)
    _cover(color, _mix((0.30, 0.27, 0.23), (0.55, 0.52, 0.47), step(grain, -0.8, 0.8)), step(stones, 0.95, 1.05))
    return color


def _rock(x: Float64Array, y: Float64Array, grain: Float32Array) -> Float32Array:
    """Grey granite with dark joints, and lichen."""
    stain = fractal_noise(x, y, (3.2, 1.5, 0.7, 0.35), 141, roughness=0.7)
    color = _mix((0.17, 0.155, 0.135), (0.42, 0.405, 0.375), step(stain + 0.3 * grain, -0.8, 0.9))
    joints = ridges(5 * smooth_noise(x, y, (1.3, 2.1), 146)) + ridges(6 * smooth_noise(x, y, (2.4, 0.8), 147))
    color *= 1 - np.float32(0.55) * np.minimum(joints, 1)
    return color


def _leaves(x: Float64Array, y: Float64Array, grain: Float32Array, height: Float32Array) -> Float32Array:
    """Leaves in clumps; layers by height keep the steep side of a shrub from looking stretched."""
    kind = fractal_noise(x, y, (5.0, 2.1, 0.9), 151, roughness=0.8)
    color = _mix((0.026, 0.046, 0.017), (0.095, 0.112, 0.034), step(kind, -0.9, 0.9))
    clumps = fractal_noise(x, y, (0.55, 0.26, 0.13, 0.065), 156, roughness=0.9)
    layers = np.sin(height * np.float32(17) + 3 * clumps)
    color *= np.exp(np.float32(0.50) * clumps + np.float32(0.32) * layers + np.float32(0.3) * grain)
    return color


def _worn_patches(x: Float64Array, y: Float64Array, distance: Float32Array, grain: Float32Array) -> Float32Array:
    """Where grass has gone: on the steep face, and a dusty strip beside the road."""
    worn = fractal_noise(x, y, (10.0, 4.5, 2.0, 0.9, 0.45), 161, roughness=0.6) + np.float32(0.3) * grain
    face = step(distance, TOE - 2, TOE + 2) * (1 - step(distance, CREST - 3, CREST + 3))
    roadside = 1 - step(np.abs(distance) + np.float32(1.1) * worn, 4.6, 6.2)
    return np.maximum(step(worn + np.float32(0.38) * face, 0.55, 0.72), roadside)


def _road_share(distance: Float32Array, grain: Float32Array) -> Float32Array:
    """The asphalt, its ragged southern edge, and the concrete drain on the north side."""
    south = step(distance + np.float32(0.10) * grain, -3.85, -3.75)
    return south * (1 - step(distance, 4.62, 4.68))


def _road(x: Float64Array, y: Float64Array, distance: Float32Array, grain: Float32Array) -> Float32Array:
    """Asphalt with wheel tracks, patches, cracks and stains; markings; a drain of concrete."""
    texel = abs(float(x[1] - x[0]))
    stains = fractal_noise(x, y, (6.0, 2.5, 1.1, 0.5), 171, roughness=0.7)
    tone = np.exp(0.16 * stains + 0.20 * grain + 0.18 * np.cos(distance * np.float32(2 * np.pi / 1.85)))
    patches = step(smooth_noise(x, y, (9.0, 2.6), 176), 0.62, 0.64)
    cracks = ridges(9 * smooth_noise(x, y, (3.1, 1.2), 177)) * step(smooth_noise(x, y, 8.0, 178), 0.0, 0.3)
    tone *= (1 - np.float32(0.35) * patches) * (1 - np.float32(0.5) * cracks)
    color: Float32Array = _channels(ASPHALT) * tone
    wear = step(grain + np.float32(0.6) * stains, -1.0, -0.5) * np.float32(0.92)
    dashes = step(np.cos(x * (2 * np.pi / 6)).astype(np.float32), 0.47, 0.53)
    _cover(color, _channels(PAINT), _line(distance, 0.0, 0.075, texel) * dashes * wear)
    for edge in (-3.2, 3.2):
        _cover(color, _channels(YELLOW_PAINT), _line(distance, edge, 0.06, texel) * wear)
    concrete = _channels(CONCRETE) * np.exp(0.18 * stains + 0.12 * grain)
    _cover(color, concrete, step(distance, 3.62, 3.68))
    return color


def _line(distance: Float32Array, middle: float, half_width: float, texel: float) -> Float32Array:
    """A painted line along the road; its edge is one texel wide, so that it doesn't alias."""
    return 1 - step(np.abs(distance - np.float32(middle)), half_width - texel / 2, half_width + texel / 2)
