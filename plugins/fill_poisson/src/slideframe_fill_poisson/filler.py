"""The stage: a Poisson surface from splats, and the soil below it."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from slideframe.errors import ConfigurationError, StageFailed
from slideframe.problem import BoxRegion, FillingProblem
from slideframe.products import Filling, SplatCloud, Survey
from slideframe.stages import Context, VolumeFiller
from slideframe_fill_poisson.coupling import STAYS, carriers
from slideframe_fill_poisson.interior import Mode, interior_splats
from slideframe_fill_poisson.lattice import Lattice, measure_volume, place_particles
from slideframe_fill_poisson.support import (
    Support,
    around,
    near_neighbors,
    outward_normals,
    solid_splats,
    surface_spacing,
)
from slideframe_fill_poisson.surface import EXTRAPOLATED, INTERPOLATED, OBSERVED, Surface, cut_out, poisson_surface

LEAST_SUPPORT = 100  # splats; fewer don't make a surface
STEPS = 6


class PoissonFiller(VolumeFiller):
    """Soil below a screened Poisson surface of the splats (Liang & Cheng 2026, section 3.3)."""

    name = "fill_poisson"
    backend: ClassVar[tuple[str, ...]] = ("open3d", "scipy")

    mode: Mode = Field(
        default="engineering",
        description="interior splats: 'paper' 1, 1.5 and 2 times as large as deep, 'engineering' never out of the soil",
    )
    interior_opacity: float = Field(default=0.95, gt=0, le=1, description="opacity of interior splats")
    color_neighbours: int = Field(
        default=32, ge=1, le=1000, description="observed splats whose mean colours an interior one; the paper takes 1"
    )
    minimum_opacity: float = Field(default=0.1, ge=0, lt=1, description="fainter splats don't support the surface")
    oversize_ratio: float = Field(
        default=8.0, gt=1, description="splats larger than this many times the median don't support the surface"
    )
    outlier_neighbors: int = Field(default=20, ge=2, le=200, description="neighbours that tell a floating splat")
    outlier_deviations: float = Field(
        default=3.0, gt=0, description="standard deviations of neighbour distance from which a splat floats"
    )
    normal_neighbors: int = Field(default=16, ge=3, le=200, description="neighbours that a normal is fitted to")
    margin: float = Field(default=0.2, ge=0, le=2, description="ground around the region to mesh, in its longer side")
    observed_spacings: float = Field(
        default=2.0, gt=0, description="surface within this many splat spacings of a splat counts as observed"
    )
    extrapolated_spacings: float = Field(
        default=8.0,
        gt=0,
        description="surface farther than this many splat spacings from any splat counts as extrapolated",
    )
    maximum_extrapolated_share: float = Field(
        default=0.5, ge=0, le=1, description="share of the region's plan without splats from which it is refused"
    )
    standing_height: float = Field(
        default=3.0, ge=0, description="splats up to this height over the surface move with the soil, m"
    )

    def fill(self, survey: Survey, splats: SplatCloud, problem: FillingProblem, context: Context) -> Filling:
        """Return the soil of the region, one particle to a lattice cell, and what rides on it."""
        region, spacing = problem.region, problem.particle_spacing
        context.progress(0, STEPS)
        support = self._support(survey, splats, region)
        context.progress(1, STEPS, support_splats=len(support.centers))
        whole = poisson_surface(
            support, self.observed_spacings * support.spacing, self.extrapolated_spacings * support.spacing
        )
        surface = cut_out(whole, around(whole.vertices, region, self._margin(region) / 2))
        context.progress(2, STEPS, vertices=len(surface.vertices))
        lattice = Lattice(region, spacing)
        self._report_support(surface, support, lattice, splats, context)
        soil = surface.soil(*lattice.columns(), region.z_min)
        positions, volumes = place_particles(soil, lattice)
        _require_soil(positions, surface, region)
        _report_volume(measure_volume(surface, lattice), volumes, context)
        context.progress(3, STEPS, particles=len(positions))
        observed = _subset(splats, support.indices)
        interior = interior_splats(
            positions, surface, spacing, self.mode, self.interior_opacity, observed, self.color_neighbours
        )
        context.progress(4, STEPS)
        moving = carriers(splats, positions, surface, region, spacing, self.standing_height)
        context.figure("moving_splats", int((moving != STAYS).sum()))
        context.progress(5, STEPS)
        filling = Filling(
            bounds=np.array(
                [[region.x_min, region.y_min, region.z_min], [region.x_max, region.y_max, positions[:, 2].max()]],
                np.float64,
            ),
            particle_positions=positions,
            particle_volumes=volumes,
            interior=interior,
            interior_particles=np.arange(len(positions), dtype=np.int32),
            surface_particles=moving,
            surface_vertices=surface.vertices,
            surface_triangles=surface.triangles,
            surface_support=surface.support,
        )
        context.progress(STEPS, STEPS)
        return filling

    def _margin(self, region: BoxRegion) -> float:
        return self.margin * max(region.x_max - region.x_min, region.y_max - region.y_min)

    def _support(self, survey: Survey, splats: SplatCloud, region: BoxRegion) -> Support:
        """Choose the splats of the ground around the region."""
        solid = solid_splats(splats, self.minimum_opacity, self.oversize_ratio)
        _require(len(solid), "opaque enough", self.minimum_opacity, splats)
        near = solid[around(splats.centers[solid], region, self._margin(region))]
        if not around(splats.centers[near], region, 0.0).sum() >= LEAST_SUPPORT:
            raise _outside(region, splats, "too few splats stand over the region")
        kept = near[
            near_neighbors(splats.centers[near].astype(np.float64), self.outlier_neighbors, self.outlier_deviations)
        ]
        centers = splats.centers[kept].astype(np.float64)
        spacing = surface_spacing(centers)
        return Support(kept, centers, outward_normals(centers, survey, self.normal_neighbors, spacing), spacing)

    def _report_support(
        self, surface: Surface, support: Support, lattice: Lattice, splats: SplatCloud, context: Context
    ) -> None:
        """Report how much of the region's plan is seen, and refuse one that mostly isn't."""
        x, y = lattice.columns()
        top = surface.top(x, y)
        meshed = np.isfinite(top)
        distance = np.full(len(x), np.inf)
        distance[meshed] = _distance_to(support.centers, np.column_stack([x, y, top])[meshed])
        limits = np.array([self.observed_spacings, self.extrapolated_spacings]) * support.spacing
        classes = np.digitize(distance, limits, right=True)
        shares = {kind: float((classes == kind).mean()) for kind in (OBSERVED, INTERPOLATED, EXTRAPOLATED)}
        context.figure("observed_share", shares[OBSERVED])
        context.figure("interpolated_share", shares[INTERPOLATED])
        context.figure("extrapolated_share", shares[EXTRAPOLATED])
        context.figure("splat_spacing_m", support.spacing)
        if shares[EXTRAPOLATED] > self.maximum_extrapolated_share:
            raise _outside(lattice.region, splats, f"no splats support {shares[EXTRAPOLATED]:.0%} of the region")
        if not meshed.all():
            context.warn(f"{1 - meshed.mean():.1%} of the region has no surface and was left without soil")


def _report_volume(region_volume: float, volumes: np.ndarray, context: Context) -> None:
    filled = float(volumes.sum(dtype=np.float64))
    context.figure("region_volume_m3", region_volume)
    context.figure("filled_volume_m3", filled)
    context.figure("volume_error_percent", 100 * (filled / region_volume - 1))
    context.figure("particles", len(volumes))


def _require(count: int, what: str, minimum_opacity: float, splats: SplatCloud) -> None:
    if count < LEAST_SUPPORT:
        raise StageFailed(
            f"only {count} of {len(splats)} splats are {what} (at least {minimum_opacity}) to make a surface",
            where="[plugins.fill_poisson] minimum_opacity",
            cure=f"lower minimum_opacity, or reconstruct more than {LEAST_SUPPORT} opaque splats",
        )


def _require_soil(positions: np.ndarray, surface: Surface, region: BoxRegion) -> None:
    if not len(positions):
        low, high = surface.vertices[:, 2].min(), surface.vertices[:, 2].max()
        raise ConfigurationError(
            f"no soil lies between the base z_min = {region.z_min:g} and the ground",
            where="[region] z_min",
            cure=f"lower z_min: the ground of the region spans z {low:.2f} to {high:.2f} m",
        )


def _outside(region: BoxRegion, splats: SplatCloud, what: str) -> ConfigurationError:
    low, high = np.percentile(splats.centers, [1, 99], axis=0)
    return ConfigurationError(
        f"{what} x {region.x_min:g} to {region.x_max:g}, y {region.y_min:g} to {region.y_max:g} m",
        where="[region] x_min, x_max, y_min, y_max",
        cure=f"choose it within the scene, x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f} m",
    )


def _subset(splats: SplatCloud, indices: np.ndarray) -> SplatCloud:
    return SplatCloud(**{name: getattr(splats, name)[indices] for name in SplatCloud.array_fields()})


def _distance_to(centers: np.ndarray, points: np.ndarray) -> np.ndarray:
    from scipy.spatial import cKDTree

    distances: np.ndarray = cKDTree(centers).query(points)[0]
    return distances
