"""Gaussians of the soil that no camera saw: one for each particle."""

from typing import Literal

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import SplatCloud
from slideframe_fill_poisson.appearance import SoilColors
from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.surface import Surface

Mode = Literal["paper", "engineering"]

# A splat is drawn to three standard deviations: what ends there below the surface doesn't show.
DRAWN_SIGMAS = 3.0
# 0.5 lattice spacings let 15 % of light through one layer, 2 % through two, 0.4 % through three.
IN_PLANE_SHARE = 0.5
SHRINKING = (1.0, 0.7, 0.5, 0.35, 0.25)
# Nearer than this to the surface, the direction to it is lost in float32.
LEAST_DEPTH = 1e-3
SPLATS_AT_ONCE = 1_000_000


def interior_splats(
    positions: Float32Array,
    surface: Surface,
    soil: Body,
    spacing: float,
    mode: Mode,
    opacity: float,
    colors: SoilColors,
) -> SplatCloud:
    """Return one splat for each position (particle, 3).

    The short axis points to the nearest surface point, at distance d. Standard deviations are (d, 1.5 d, 2 d)
    in paper mode (Liang & Cheng 2026, section 3.3), the long axis lying level. In engineering mode they are
    d / 3 or less along the short axis and half a spacing in plane, less where the surface curves
    into them: at three of them, no axis leaves the soil.
    """
    count = len(positions)
    rotations, scales = np.empty((count, 4), np.float32), np.empty((count, 3), np.float32)
    harmonics = np.empty((count, 1, 3), np.float32)
    for first in range(0, count, SPLATS_AT_ONCE):
        part = slice(first, first + SPLATS_AT_ONCE)
        points = positions[part]
        foot, vertex = surface.nearest_of_many(points, spacing)
        towards = (foot - points).astype(np.float64)
        depth = np.maximum(np.linalg.norm(towards, axis=1), LEAST_DEPTH)
        axes = axes_about(towards / depth[:, None])
        rotations[part] = quaternions_of(axes)
        if mode == "paper":
            scales[part] = depth[:, None] * np.array([1.0, 1.5, 2.0])
        else:
            scales[part] = _hidden_scales(points, axes, depth, soil, spacing)
        harmonics[part] = colors.at(points, foot, vertex, spacing)
    return SplatCloud(
        centers=positions,
        rotations=rotations,
        scales=scales,
        opacities=np.full(count, opacity, np.float32),
        harmonics=harmonics,
    )


def _hidden_scales(
    positions: Float32Array, axes: Float64Array, depth: Float64Array, soil: Body, spacing: float
) -> Float64Array:
    """Return standard deviations (particle, 3) whose drawn ends stay in the soil."""
    plane = IN_PLANE_SHARE * spacing
    normal = np.minimum(depth / DRAWN_SIGMAS, plane)
    # a ball of radius `depth` is all soil, so only shallower splats can stick out sideways
    in_plane = np.full(len(depth), plane)
    doubtful = np.flatnonzero(DRAWN_SIGMAS * plane > depth)
    for share in SHRINKING:
        in_plane[doubtful] = share * plane
        reach = DRAWN_SIGMAS * in_plane[doubtful, None, None] * axes[doubtful, :, 1:].transpose(0, 2, 1)
        ends = positions[doubtful, None] + np.concatenate([reach, -reach], axis=1)
        out = ~soil.inside(ends.reshape(-1, 3).astype(np.float32)).reshape(-1, 4).all(axis=1)
        doubtful = doubtful[out]
    in_plane[doubtful] = np.minimum(depth[doubtful] / DRAWN_SIGMAS, plane)
    return np.column_stack([normal, in_plane, in_plane])


def axes_about(short: Float64Array) -> Float64Array:
    """Return right-handed axes (splat, 3, 3), one a column: short (a unit vector, or zero for up), middle, level."""
    up = np.array([0.0, 0.0, 1.0])
    level = np.cross(up, short)
    upright = np.linalg.norm(level, axis=1) < 1e-6
    level[upright] = (1.0, 0.0, 0.0)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    short = np.where(np.linalg.norm(short, axis=1, keepdims=True) > 0.5, short, up)
    return np.stack([short, np.cross(level, short), level], axis=-1)


def quaternions_of(axes: Float64Array) -> Float64Array:
    """Convert rotation matrices (splat, 3, 3) to quaternions w, x, y, z of unit length."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(axes).as_quat(), 1, axis=1)
