"""The filled volume: surface, outline, slip surface, particles, a section, and numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Filling
from slideframe.quality.surface import SurfaceComparison
from slideframe.quality.surface_map import draw_difference
from slideframe.record.blueprint import DIFFERENCE
from slideframe.record.drawing import DRAWN_SPLATS, heat, log_picture, spacing_of, thinned
from slideframe.record.numbers import numbers_table
from slideframe.record.section import Profile, draw_section
from slideframe.release.grid import bilinear, lowest_heights
from slideframe.release.plan import Plan

OBSERVED_COLOR = (90, 170, 120)
INFERRED_COLOR = (200, 120, 60)
SUPPORT_COLORS = np.array([OBSERVED_COLOR, (230, 190, 60), INFERRED_COLOR], np.uint8)
OUTLINE_COLOR = (240, 240, 240)
SLIP_SURFACE_COLOR = (150, 80, 60)
MOST_NODES = 400_000
SECTION_STEPS = 400
FENCES = (0.02, 0.35, 0.65, 0.98)  # where upright planes of particles stand, in shares of the mass's extent
FENCE_WIDTH = 1.5  # particle spacings
LIFT = 0.15  # m by which the outline floats over the ground


def log_filling(
    stream: rr.RecordingStream,
    filling: Filling,
    plan: Plan,
    figures: Mapping[str, Any] | None = None,
    comparison: SurfaceComparison | None = None,
) -> None:
    """Log what the soil is, what of it was seen, and what it rests on.

    Args:
        stream: to log to.
        filling: the soil.
        plan: of the region.
        figures: what the filler and the comparison with a reference ground measured, for the table.
        comparison: of the surface with the reference ground, for a map.
    """
    _log_surface(stream, filling)
    heights = _Heights(filling)
    rings = [_on_ground(ring, heights) for ring in plan.rings]
    stream.log("volume/outline", rr.LineStrips3D(rings, colors=OUTLINE_COLOR, radii=-1.5), static=True)
    _log_slip_surface(stream, filling, plan)
    depth = _log_particles(stream, filling, heights)
    if len(filling.terrain_triangles):
        _log_section(stream, filling, heights)
    if comparison is not None:
        log_picture(stream, DIFFERENCE, draw_difference(comparison))
    table = numbers_table(filling, depth, figures or {})
    stream.log("volume/numbers", rr.TextDocument(table, media_type="text/markdown"), static=True)


class _Heights:
    """Ground before and after, on a grid over the surface."""

    def __init__(self, filling: Filling) -> None:
        corners = np.concatenate([filling.surface_vertices, filling.bounds])[:, :2].astype(np.float64)
        low, high = corners.min(axis=0), corners.max(axis=0)
        step = max(0.5 * spacing_of(filling), float(np.sqrt(np.prod(high - low) / MOST_NODES)))
        self.x, self.y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
        self.before = self._highest(filling.surface_vertices, filling.surface_triangles)
        self.after = self._highest(filling.terrain_vertices, filling.terrain_triangles)

    def _highest(self, vertices: Float32Array, triangles: npt.NDArray[np.int32]) -> Float64Array:
        upside_down = vertices.astype(np.float64) * [1, 1, -1]
        return -lowest_heights(self.x, self.y, upside_down, triangles)

    def at(self, field: Float64Array, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> Float64Array:
        """Interpolate a height field; NaN where it has none."""
        return bilinear(self.x, self.y, field, x, y)


def _log_surface(stream: rr.RecordingStream, filling: Filling) -> None:
    stream.log(
        "volume/surface",
        rr.Mesh3D(
            vertex_positions=filling.surface_vertices,
            triangle_indices=filling.surface_triangles,
            vertex_normals=_vertex_normals(filling.surface_vertices, filling.surface_triangles),
            vertex_colors=SUPPORT_COLORS[filling.surface_support],
        ),
        static=True,
    )


def _on_ground(ring: Float64Array, heights: _Heights) -> Float64Array:
    """Return the closed ring, lifted onto the ground by its own small steps."""
    closed = np.concatenate([ring, ring[:1]])
    lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    along = np.unique(np.r_[np.arange(0, lengths[-1], 2 * (heights.x[1] - heights.x[0])), lengths])
    x, y = (np.interp(along, lengths, closed[:, axis]) for axis in range(2))
    z = heights.at(heights.before, x, y)
    known = np.isfinite(z)
    z = np.interp(along, along[known], z[known]) if known.any() else np.zeros_like(along)
    return np.column_stack([x, y, z + LIFT])


def _log_slip_surface(stream: rr.RecordingStream, filling: Filling, plan: Plan) -> None:
    """Log the terrain's faces that the surface doesn't have: slip surface and sides of the pit."""
    chosen = slip_faces(filling, plan)
    if not len(chosen):
        return
    normals = _face_normals(filling.terrain_vertices[chosen])
    shade = (0.5 + 0.5 * np.abs(normals[:, 2]))[:, None] * SLIP_SURFACE_COLOR
    stream.log(
        "volume/slip_surface",
        rr.Mesh3D(
            vertex_positions=filling.terrain_vertices[chosen].reshape(-1, 3),
            triangle_indices=np.arange(3 * len(chosen)).reshape(-1, 3),
            vertex_colors=np.repeat(shade.astype(np.uint8), 3, axis=0),
        ),
        static=True,
    )


def slip_faces(filling: Filling, plan: Plan) -> npt.NDArray[np.int32]:
    """Return the terrain's triangles (triangle, 3) that aren't scanned ground."""
    seen = {row.tobytes() for row in filling.surface_vertices}
    known = np.array([row.tobytes() in seen for row in filling.terrain_vertices], bool)
    triangles = filling.terrain_triangles[~known[filling.terrain_triangles].all(axis=1)]
    if not len(triangles):
        return triangles
    middle = filling.terrain_vertices[triangles].mean(axis=1).astype(np.float64)
    within = plan.contains(middle[:, 0], middle[:, 1])
    within |= plan.distance_to_outline(middle[:, 0], middle[:, 1]) < 1e-3
    return triangles[within]


def _log_particles(stream: rr.RecordingStream, filling: Filling, heights: _Heights) -> Float64Array:
    """Log particles of a fence diagram by depth and by what of them was seen; return all depths (particle,), m."""
    positions = filling.particle_positions
    ground = heights.at(heights.before, positions[:, 0], positions[:, 1])
    depth = np.maximum(np.nan_to_num(ground - positions[:, 2]), 0)
    fence = np.flatnonzero(on_fences(filling))
    drawn = fence[thinned(len(fence), DRAWN_SPLATS // 2)]
    radius = 0.5 * spacing_of(filling)
    share = depth[drawn] / max(float(depth.max(initial=0)), 1e-6)
    stream.log("volume/by_depth", rr.Points3D(positions[drawn], colors=heat(share), radii=radius), static=True)
    carried = np.zeros(len(positions), bool)
    carried[filling.surface_particles[filling.surface_particles >= 0]] = True
    colors = np.where(carried[drawn, None], OBSERVED_COLOR, INFERRED_COLOR).astype(np.uint8)
    stream.log("volume/by_origin", rr.Points3D(positions[drawn], colors=colors, radii=radius), static=True)
    return depth


def on_fences(filling: Filling) -> npt.NDArray[np.bool_]:
    """Tell which particles stand on a few upright planes down and across the slope (particle,).

    All particles together would show their outermost layer alone.
    """
    positions = filling.particle_positions[:, :2].astype(np.float64)
    start, end = _section_line(filling)
    down = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    chosen = np.zeros(len(positions), bool)
    for way in (down, np.array([-down[1], down[0]])):
        along = positions @ way
        for share in FENCES:
            place = along.min() + share * np.ptp(along)
            chosen |= np.abs(along - place) <= FENCE_WIDTH / 2 * spacing_of(filling)
    return chosen


def _log_section(stream: rr.RecordingStream, filling: Filling, heights: _Heights) -> None:
    start, end = _section_line(filling)
    share = np.linspace(0, 1, SECTION_STEPS)
    x, y = (start[axis] + share * (end - start)[axis] for axis in range(2))
    length = float(np.linalg.norm(end - start))
    positions = filling.particle_positions.astype(np.float64)
    across = np.array([-(end - start)[1], (end - start)[0]]) / length
    near = np.abs((positions[:, :2] - start) @ across) < 0.5 * spacing_of(filling)
    profile = Profile(
        distance=share * length,
        ground=heights.at(heights.before, x, y),
        terrain=heights.at(heights.after, x, y),
        support=filling.surface_support[_nearest_vertex(filling, x, y)],
        particles=np.column_stack([(positions[near, :2] - start) @ (end - start) / length, positions[near, 2]]),
        spacing=spacing_of(filling),
        bearing=float(np.degrees(np.arctan2(*(end - start))) % 360),
    )
    log_picture(stream, "volume/section", draw_section(profile, SUPPORT_COLORS))


def _section_line(filling: Filling) -> tuple[Float64Array, Float64Array]:
    """Return the ends of a line down the slope through the middle of the mass, half as long again as the mass."""
    positions, volumes = filling.particle_positions.astype(np.float64), filling.particle_volumes.astype(np.float64)
    middle = np.average(positions, axis=0, weights=volumes)
    offset = positions - middle
    slope = np.linalg.lstsq(offset[:, :2], offset[:, 2], rcond=None)[0]
    if np.linalg.norm(slope) < 1e-3:
        slope = np.array([0.0, 1.0])
    way = -slope / np.linalg.norm(slope)
    reach = offset[:, :2] @ way
    return middle[:2] + 1.5 * reach.min() * way, middle[:2] + 1.5 * reach.max() * way


def _nearest_vertex(filling: Filling, x: Float64Array, y: Float64Array) -> npt.NDArray[np.int64]:
    """Return the vertex of the surface nearest to each place in plan; few places, so that plain search does."""
    plan = filling.surface_vertices[:, :2]
    places = np.column_stack([x, y]).astype(np.float32)
    return np.array([np.square(plan - place).sum(axis=1).argmin() for place in places])


def _vertex_normals(vertices: Float32Array, triangles: npt.NDArray[np.int32]) -> Float64Array:
    """Return the mean normals (vertex, 3) of the triangles about each vertex, larger ones counting more."""
    sums = np.zeros((len(vertices), 3))
    faces = _cross(vertices[triangles].astype(np.float64))
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    units: Float64Array = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    return units


def _face_normals(corners: npt.NDArray[np.floating]) -> Float64Array:
    normals = _cross(corners.astype(np.float64))
    units: Float64Array = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return units


def _cross(corners: Float64Array) -> Float64Array:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
