"""How far the scan's surface is from ground known otherwise."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError, SlideframeError
from slideframe.formats.rasters import read_raster
from slideframe.problem import ReferenceGround, Region
from slideframe.products import Filling, Georeference, Survey
from slideframe.release.grid import lowest_heights
from slideframe.release.plan import Plan, plan_of
from slideframe.release.sampling import sample_heights

MOST_NODES = 250_000
LEAST_NODES = 10_000
LEAST_SHARE = 0.5  # of the region that the reference must cover to speak for it


@dataclass(frozen=True, eq=False)
class SurfaceComparison:
    """Height of the scan's surface over the reference, on a grid over the region.

    Attributes:
        x: eastings of the nodes (column,), m.
        y: northings of the nodes (row,), m.
        difference: surface minus reference (column, row), m; NaN outside the region and where either has no height.
        covered_share: share of the region's nodes with both heights.
    """

    x: Float64Array
    y: Float64Array
    difference: Float64Array
    covered_share: float

    def figures(self, splat_spacing: float | None = None) -> dict[str, float]:
        """Return what is reported, units in the names; the spacing of splats on the surface is in m.

        Bias is the mean of surface minus reference, and the root mean square includes it.
        """
        gaps = self.difference[np.isfinite(self.difference)]
        if not gaps.size:
            return {"reference_covered_share": 0.0}
        rmse = float(np.sqrt(np.mean(gaps**2)))
        found = {
            "reference_rmse_m": rmse,
            "reference_bias_m": float(gaps.mean()),
            "reference_p95_m": float(np.percentile(np.abs(gaps), 95)),
            "reference_covered_share": self.covered_share,
        }
        return found | ({"reference_rmse_splat_spacings": rmse / splat_spacing} if splat_spacing else {})


def compare_surface(
    filling: Filling, plan: Plan, reference: ReferenceGround, georeference: Georeference
) -> SurfaceComparison:
    """Compare the filling's surface, its highest face at each place, with a height model within the plan.

    Raises:
        ConfigurationError: the height model isn't where the region is.
        InputError, MissingDependency: it can't be read.
    """
    x, y, inside = _nodes(plan)
    upside_down = filling.surface_vertices.astype(np.float64) * [1, 1, -1]
    surface = -lowest_heights(x, y, upside_down, filling.surface_triangles)
    surface[~inside] = np.nan
    across, along = np.meshgrid(x, y, indexing="ij")
    known = np.isfinite(surface)
    difference = np.full(surface.shape, np.nan)
    if known.any():
        places = np.column_stack([across[known], along[known], surface[known]])
        heights = sample_heights(read_raster(reference.path), reference, places, georeference, _where(reference))
        difference[known] = surface[known] - heights
    return SurfaceComparison(x, y, difference, float(np.isfinite(difference).sum() / max(inside.sum(), 1)))


def require_readable(reference: ReferenceGround) -> None:
    """Read the reference, so that a fault in it is told before anything is computed.

    Raises:
        InputError, MissingDependency: it can't be read.
    """
    try:
        read_raster(reference.path)
    except SlideframeError as error:
        error.where = _where(reference)
        raise


def require_reference_over_region(survey: Survey, region: Region, reference: ReferenceGround) -> None:
    """Refuse a reference that has no heights for most of the region, before hours are spent.

    Raises:
        ConfigurationError: with what it covers.
        InputError, MissingDependency: it can't be read.
    """
    plan = plan_of(region, survey.georeference)
    x, y, inside = _nodes(plan)
    across, along = (grid[inside] for grid in np.meshgrid(x, y, indexing="ij"))
    level = float(np.median(survey.sparse_points[:, 2])) if len(survey.sparse_points) else 0.0
    places = np.column_stack([across, along, np.full(len(across), level)])
    heights = sample_heights(read_raster(reference.path), reference, places, survey.georeference, _where(reference))
    share = float(np.isfinite(heights).mean())
    if share < LEAST_SHARE:
        raise ConfigurationError(
            f"the reference ground covers {share:.0%} of the region only",
            where=_where(reference),
            cure=f"give one that covers {LEAST_SHARE:.0%} or more of it, or leave [reference_ground] out",
        )


def _where(reference: ReferenceGround) -> str:
    return f"[reference_ground] {reference.path}"


def _nodes(plan: Plan) -> tuple[Float64Array, Float64Array, np.ndarray]:
    """Return eastings (column,), northings (row,), and which nodes lie in the plan (column, row)."""
    sides = plan.bounds[1] - plan.bounds[0]
    count = int(np.clip(MOST_NODES * plan.area / float(np.prod(sides)), LEAST_NODES, MOST_NODES))
    step = float(np.sqrt(np.prod(sides) / count))
    x, y = (np.arange(low + step / 2, high, step) for low, high in plan.bounds.T)
    across, along = np.meshgrid(x, y, indexing="ij")
    return x, y, plan.contains(across.ravel(), along.ravel()).reshape(across.shape)
