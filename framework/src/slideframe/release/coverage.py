"""What of a region can be judged before there is a surface: its files, and where its base lies."""

import numpy as np

from slideframe.arrays import Float32Array
from slideframe.errors import ConfigurationError
from slideframe.formats.meshes import read_mesh
from slideframe.formats.outlines import read_outlines
from slideframe.formats.rasters import read_raster
from slideframe.problem import (
    DepthBase,
    EarlierGroundBase,
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
