"""What of a region can be judged before there is a surface: its files, and where its base lies."""

import numpy as np

from slideframe.arrays import Float32Array
from slideframe.errors import ConfigurationError
from slideframe.formats.meshes import read_mesh
from slideframe.formats.outlines import read_outlines
from slideframe.formats.rasters import read_raster
from slideframe.problem import (
    DepthBase,
    Domain,
    EarlierGroundBase,
    FlatBase,
    MeshBase,
    MeshRegion,
    PolygonRegion,
    RasterBase,
    Region,
    SlblBase,
)
from slideframe.products import Georeference
from slideframe.release.plan import Plan
from slideframe.release.slip_surface import release_grid

COARSE_CELLS = 60  # along the plan's longer side
# Of the ground seen in the region, what walls may cut off before there is a surface: points scatter.
STRAY_SHARE = 0.1


def read_region_files(region: Region) -> None:
    """Read every file that a region names, so that a fault in one is told at once.

    Raises:
        InputError, MissingDependency: as the readers.
    """
    if isinstance(region, MeshRegion):
        read_mesh(region.path)
        return
    if isinstance(region, PolygonRegion) and region.path is not None:
        read_outlines(region.path, region.layer)
    base = region.slip_surface
    if isinstance(base, RasterBase | EarlierGroundBase):
        read_raster(base.path)
    if isinstance(base, MeshBase):
        read_mesh(base.path)


def require_base_below(region: Region, plan: Plan, points: Float32Array, georeference: Georeference) -> None:
    """Refuse a slip surface that is nowhere below the points (point, 3) that the survey saw in the plan.

    Raises:
        ConfigurationError: with the heights of both, or what else is wrong with the base.
        InputError, MissingDependency: a file can't be read.
    """
    if isinstance(region, MeshRegion):
        return
    base = region.slip_surface
    if isinstance(base, SlblBase | DepthBase):
        return  # they follow the ground, wherever it is
    top = float(points[:, 2].max())
    spacing = float((plan.bounds[1] - plan.bounds[0]).max()) / COARSE_CELLS
    grid = release_grid(region, plan, lambda x, y: np.full(x.shape, top), spacing, georeference)
    if isinstance(base, EarlierGroundBase) or (isinstance(base, RasterBase) and base.quantity == "depth"):
        return  # what they leave depends on the ground's shape
    across, along = np.meshgrid(grid.x, grid.y, indexing="ij")
    inside = plan.contains(across.ravel(), along.ravel()).reshape(across.shape)
    heights = grid.base[inside & np.isfinite(grid.base)]
    if heights.size and heights.min() < top:
        return
    where = "region.base" if region.kind != "box" or region.base is not None else "region.z_min"
    lowest = f"from {heights.min():.2f} m up" if heights.size else "nowhere in the region"
    raise ConfigurationError(
        f"the base ({lowest}) isn't below the ground that the survey saw in the region, at {points[:, 2].min():.2f} "
        f"to {top:.2f} m",
        where=where,
        cure="lower the base; heights are metres up of the survey's origin, unless epsg says otherwise",
    )


def require_walls_around(region: Region, plan: Plan, domain: Domain, points: Float32Array) -> None:
    """Refuse walls that stand in the mass, so that ground of the survey's points (point, 3) lies behind them.

    Raises:
        ConfigurationError: with how much of it.
    """
    seen = points[plan.contains(points[:, 0], points[:, 1])]
    if isinstance(region, MeshRegion):
        return
    if isinstance(region.slip_surface, FlatBase):
        seen = seen[seen[:, 2] > region.slip_surface.z_min]
    if not len(seen):
        return
    low = np.array([domain.x_min, domain.y_min, None], np.float64)
    high = np.array([domain.x_max, domain.y_max, domain.z_max], np.float64)
    outside = ((seen < low) | (seen > high)).any(axis=1)  # nothing is beyond a wall that isn't given, NaN
    if outside.mean() > STRAY_SHARE:
        (west, south), (east, north) = plan.bounds
        raise ConfigurationError(
            f"{outside.mean():.0%} of the ground that the survey saw in the region lies behind the domain's walls",
            where="boundary.domain",
            cure=f"the region spans x {west:.1f} to {east:.1f}, y {south:.1f} to {north:.1f} m, and its ground reaches "
            f"up to {seen[:, 2].max():.1f} m: let the domain hold that, or make the region smaller",
        )


def volume_under(region: Region, plan: Plan, points: Float32Array, georeference: Georeference) -> float:
    """Return about how much soil lies between the base and the sparse points (point, 3), m3.

    Nothing where only the true ground can tell, as in a mesh or over a base that is found from the ground's shape.

    Raises:
        ConfigurationError, InputError, MissingDependency: as `release_grid`.
    """
    seen = points[plan.contains(points[:, 0], points[:, 1])]
    if isinstance(region, MeshRegion) or not len(seen):
        return 0.0
    base = region.slip_surface
    if isinstance(base, DepthBase):
        return plan.area * base.depth
    if isinstance(base, SlblBase | EarlierGroundBase) or (isinstance(base, RasterBase) and base.quantity == "depth"):
        return 0.0
    top = float(seen[:, 2].max())
    spacing = float((plan.bounds[1] - plan.bounds[0]).max()) / COARSE_CELLS
    grid = release_grid(region, plan, lambda x, y: np.full(x.shape, top), spacing, georeference)
    row, column = (np.abs(seen[:, axis, None] - line).argmin(axis=1) for axis, line in enumerate((grid.x, grid.y)))
    thickness = np.maximum(seen[:, 2] - grid.base[row, column], 0.0)
    known = np.isfinite(thickness)
    if not known.any():
        return 0.0
    # cell by cell, since some see many points and others few
    place = (row * len(grid.y) + column)[known]
    points_seen = np.bincount(place)
    means = np.bincount(place, thickness[known])[points_seen > 0] / points_seen[points_seen > 0]
    return plan.area * float(means.mean())
