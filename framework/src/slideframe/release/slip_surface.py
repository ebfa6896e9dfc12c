"""The slip surface of each kind of base, on a grid over the plan."""

from collections.abc import Callable
from functools import singledispatch

import numpy as np

from slideframe.arrays import Float64Array, Int32Array
from slideframe.errors import ConfigurationError
from slideframe.formats.meshes import read_mesh
from slideframe.formats.rasters import Raster, read_raster
from slideframe.problem import (
    DepthBase,
    EarlierGroundBase,
    EllipsoidBase,
    FlatBase,
    MeshBase,
    MeshRegion,
    PlaneBase,
    RasterBase,
    Region,
    SlblBase,
    SlipSurface,
)
from slideframe.products import Georeference
from slideframe.release.coordinates import local_points
from slideframe.release.fits import fit_ellipsoid, fit_plane
from slideframe.release.grid import Area, ReleaseGrid, bilinear, lowest_heights
from slideframe.release.plan import Plan
from slideframe.release.sampling import sample_heights, sample_values
from slideframe.release.slbl import base_level

GroundHeights = Callable[[Float64Array, Float64Array], Float64Array]

LEAST_CELLS = 100  # along the plan's longer side
MOST_NODES = 1_000_000
SLBL_CELLS = 120  # along the plan's longer side: the surface is smooth
WHERE = "[region.base]"
ALIGNMENT_POINTS = 60  # along a side of the surroundings
LEAST_ALIGNMENT = 50  # points of common ground


def release_grid(
    region: Region, plan: Plan, ground: GroundHeights, spacing: float, georeference: Georeference
) -> ReleaseGrid:
    """Work the slip surface out on a grid of about `spacing` metres.

    Args:
        region: whose slip surface is meant.
        plan: its area.
        ground: returns the highest ground at (x, y), minus infinity where there is none, m.
        spacing: of nodes, m; finer for a small plan, coarser for a vast one.
        georeference: the survey's.

    Raises:
        ConfigurationError: the slip surface can't be had from what is given.
        InputError, MissingDependency: a file can't be read.
    """
    sides = plan.bounds[1] - plan.bounds[0]
    spacing = max(min(spacing, float(sides.max()) / LEAST_CELLS), float(np.sqrt(np.prod(sides) / MOST_NODES)))
    area = Area(plan, ground, *axes_over(plan.bounds, spacing), georeference)
    if isinstance(region, MeshRegion):
        vertices, triangles = _mesh(region, str(region.path), georeference)
        return ReleaseGrid(area.x, area.y, area.heights, lowest_heights(area.x, area.y, vertices, triangles), {})
    base, figures = _heights(region.slip_surface, area)
    return ReleaseGrid(area.x, area.y, area.heights, base, figures)


def axes_over(bounds: Float64Array, spacing: float) -> tuple[Float64Array, Float64Array]:
    """Return evenly spaced nodes that reach one cell over the bounds on every side."""
    axes = []
    for low, high in bounds.T:
        cells = max(int(np.ceil((high - low) / spacing)), 1)
        axes.append(low + (high - low) / cells * np.arange(-1, cells + 2))
    return axes[0], axes[1]


Heights = tuple[Float64Array, dict[str, float]]


@singledispatch
def _heights(base: SlipSurface, area: Area) -> Heights:
    """Return the base (column, row), m, NaN where nothing moves, and figures about it."""
    raise TypeError(f"{type(base).__name__} is no slip surface")


@_heights.register
def _(base: FlatBase, area: Area) -> Heights:
    return np.full(area.heights.shape, base.z_min), {}


@_heights.register
def _(base: DepthBase, area: Area) -> Heights:
    return area.known(area.heights - base.depth), {}


@_heights.register
def _(base: PlaneBase, area: Area) -> Heights:
    points = local_points(np.array(base.points), base, area.georeference, f"{WHERE} points")
    (a, b, c), left = fit_plane(points, f"{WHERE} points")
    return a * area.across + b * area.along + c, {"base_fit_error_m": left}


@_heights.register
def _(base: EllipsoidBase, area: Area) -> Heights:
    points = local_points(np.array(base.points), base, area.georeference, f"{WHERE} points")
    ellipsoid, left = fit_ellipsoid(points, base.axis_ratio, base.azimuth, f"{WHERE} points")
    return ellipsoid.underside(area.across, area.along), {"base_fit_error_share": left}


@_heights.register
def _(base: SlblBase, area: Area) -> Heights:
    sides = area.plan.bounds[1] - area.plan.bounds[0]
    x, y = axes_over(area.plan.bounds, float(sides.max()) / SLBL_CELLS)
    coarse = Area(area.plan, area.ground, x, y, area.georeference)
    if not np.isfinite(coarse.heights).all():
        raise ConfigurationError(
            "the sloping local base level needs ground under all of the region and its rim",
            where="[region]",
            cure="draw the region within the scanned ground",
        )
    surface, curvature = base_level(x, y, coarse.heights, area.plan, base.maximum_depth)
    fine = bilinear(x, y, surface, area.across, area.along)
    return np.where(np.isnan(fine), area.heights, np.minimum(fine, area.heights)), {"slbl_curvature_per_m": curvature}


@_heights.register
def _(base: RasterBase, area: Area) -> Heights:
    raster = read_raster(base.path)
    if base.quantity == "height":
        return _heights_of(raster, base, area), {}
    values = sample_values(raster, base, _nodes(area), area.georeference, str(base.path))
    # "whatever the sign": some count depths downwards, some as a change of height
    depth = np.abs(values).reshape(area.across.shape)
    return area.known(np.where(depth > 0, area.heights - depth, np.nan)), {}


@_heights.register
def _(base: MeshBase, area: Area) -> Heights:
    vertices, triangles = _mesh(base, str(base.path), area.georeference)
    return lowest_heights(area.x, area.y, vertices, triangles), {}


@_heights.register
def _(base: EarlierGroundBase, area: Area) -> Heights:
    raster = read_raster(base.path)
    earlier = _heights_of(raster, base, area)
    shift, scatter = _alignment(raster, base, area) if base.align else (0.0, 0.0)
    risen = area.heights - (earlier + shift)
    figures = {"earlier_ground_shift_m": shift, "earlier_ground_scatter_m": scatter} if base.align else {}
    return np.where(risen >= base.least_thickness, earlier + shift, np.nan), figures


def _alignment(raster: Raster, base: EarlierGroundBase, area: Area) -> tuple[float, float]:
    """Return by how much the earlier ground lies too low around the region, and how the differences scatter, m.

    The median, and 1.4826 times the median absolute deviation (Hoehle & Hoehle 2009): change and plants
    around the region don't move them.
    """
    around = (area.plan.bounds[1] - area.plan.bounds[0]) / 2
    x, y = (
        np.linspace(low - side, high + side, ALIGNMENT_POINTS)
        for low, high, side in zip(*area.plan.bounds, around, strict=True)
    )
    wide = Area(area.plan, area.ground, x, y, area.georeference)
    outside = ~area.plan.contains(wide.across.ravel(), wide.along.ravel()).reshape(wide.across.shape)
    difference = wide.heights - _heights_of(raster, base, wide)
    difference = difference[outside & np.isfinite(difference)]
    if len(difference) < LEAST_ALIGNMENT:
        raise ConfigurationError(
            "too little ground around the region is both in the scan and in the earlier ground to align them",
            where=f"{WHERE} align",
            cure="give an earlier ground that reaches beyond the region, or align = false with geoid_offset",
        )
    shift = float(np.median(difference))
    return shift, float(1.4826 * np.median(np.abs(difference - shift)))


def _heights_of(raster: Raster, base: RasterBase | EarlierGroundBase, area: Area) -> Float64Array:
    """Return a height model's values at the grid's nodes (column, row), heights in the local frame, m."""
    values = sample_heights(raster, base, _nodes(area), area.georeference, str(base.path))
    return values.reshape(area.across.shape)


def _nodes(area: Area) -> Float64Array:
    """Return the grid's nodes on the ground (node, 3), m; where there is none, at its median height."""
    known = area.known(area.heights)
    height = np.where(np.isfinite(known), known, np.nanmedian(known))
    return np.column_stack([area.across.ravel(), area.along.ravel(), height.ravel()])


def _mesh(given: MeshBase | MeshRegion, where: str, georeference: Georeference) -> tuple[Float64Array, Int32Array]:
    vertices, triangles = read_mesh(given.path)
    return local_points(vertices, given, georeference, where), triangles
