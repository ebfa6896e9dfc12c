"""Regions that hold no mass, and why."""

import numpy as np

from slideframe.errors import ConfigurationError
from slideframe.problem import MeshRegion, Region
from slideframe.products import SplatCloud
from slideframe.release.grid import ReleaseGrid
from slideframe.release.plan import Plan
from slideframe_fill_poisson.solids import Solid


def require_mass(mass: Solid, region: Region, plan: Plan, grid: ReleaseGrid, spacing: float) -> None:
    """Refuse a mass that is empty or too thin to be filled.

    Raises:
        ConfigurationError: with the heights of base and ground.
    """
    if not mass.is_empty and mass.volume > 0:
        if mass.volume < spacing**3:
            raise too_thin(mass.volume, spacing)
        return
    across, along = np.meshgrid(grid.x, grid.y, indexing="ij")
    inside = plan.contains(across.ravel(), along.ravel()).reshape(across.shape)
    ground, base = grid.ground[inside & np.isfinite(grid.ground)], grid.base[inside & np.isfinite(grid.base)]
    if isinstance(region, MeshRegion):
        what, where, cure = "no soil lies within the mesh of the region", str(region.path), "lower the mesh"
    else:
        what = f"no soil lies between the base{_span(base)} and the ground"
        where, cure = "[region] z_min or base", "lower the base"
    raise ConfigurationError(what, where=where, cure=f"{cure}: the ground of the region spans z{_span(ground)}")


def too_thin(volume: float, spacing: float) -> ConfigurationError:
    """Say that particles are farther apart than the mass is thick."""
    return ConfigurationError(
        f"the moving mass of {volume:.3g} m3 is too thin for particles {spacing:g} m apart",
        where="[simulation] grid_spacing",
        cure="lower grid_spacing, or the base",
    )


def outside(plan: Plan, splats: SplatCloud, what: str) -> ConfigurationError:
    """Say that the splats are elsewhere."""
    low, high = np.percentile(splats.centers, [1, 99], axis=0)
    (west, south), (east, north) = plan.bounds
    return ConfigurationError(
        f"{what} x {west:g} to {east:g}, y {south:g} to {north:g} m",
        where="[region] x_min, x_max, y_min, y_max; corners; path",
        cure=f"choose it within the scene, x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f} m",
    )


def _span(heights: np.ndarray) -> str:
    if not heights.size:
        return ", which is nowhere there,"
    low, high = float(heights.min()), float(heights.max())
    return f" {low:.2f} m" if high - low < 0.005 else f" {low:.2f} to {high:.2f} m"
