"""The stage: a Poisson surface from splats, and the soil below it."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.device import Device
from slideframe.errors import StageFailed
from slideframe.formats.meshes import read_mesh
from slideframe.guards import check_particles
from slideframe.problem import FillingProblem, MeshRegion, ProblemModel, Share
from slideframe.products import Filling, Georeference, SplatCloud, Survey
from slideframe.release.coverage import read_region_files
from slideframe.release.grid import ReleaseGrid
from slideframe.release.plan import Plan, plan_of
from slideframe.release.slip_surface import release_grid
from slideframe.stages import Context, VolumeFiller
from slideframe_fill_poisson.appearance import SoilColors
from slideframe_fill_poisson.coupling import STAYS, Standing, carriers
from slideframe_fill_poisson.excavation import (
    Excavation,
    closed_room,
    excavate,
    ground_of,
    room_above,
    room_of,
    soil_body,
)
from slideframe_fill_poisson.interior import Mode, interior_splats
from slideframe_fill_poisson.lattice import Lattice
from slideframe_fill_poisson.photographed import photographed_colors
from slideframe_fill_poisson.placement import Placement, fill_body
from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.refusals import outside, require_mass, too_thin
from slideframe_fill_poisson.scar import scar_splats
from slideframe_fill_poisson.solids import GROUND, Mesh, Solid
from slideframe_fill_poisson.standing import occupied_area, standing_splats
from slideframe_fill_poisson.support import (
    Support,
    distance_to,
    near_neighbors,
    outward_normals,
    solid_splats,
    surface_spacing,
    widened,
    within,
)
from slideframe_fill_poisson.surface import (
    EXTRAPOLATED,
    INTERPOLATED,
    OBSERVED,
    Surface,
    poisson_sheet,
    support_classes,
    unsupported_rim,
)

LEAST_SUPPORT = 100  # splats; fewer don't make a surface
STEPS = 6
RESCALING_TO_TELL = 0.03
RESCALING_TO_REFUSE = 2.0  # a mass of which particles find less than half is thinner than they are wide
GROUND_SPACINGS = 1.5
SUSPECTED_WIDTH = 8.0  # m: of trees, looked for to tell of them
STANDING_TO_TELL = 0.02
SPACINGS_TO_TELL = 3.0  # of particles: larger splats of opened ground hide what lies behind them


class PoissonFiller(VolumeFiller):
    """Soil below a screened Poisson surface of the splats (Liang & Cheng 2026, section 3.3)."""

    name = "fill_poisson"
    backend: ClassVar[tuple[str, ...]] = ("open3d", "scipy", "manifold3d")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "paper": {"mode": "paper", "placement": "lattice", "color_neighbours": 1},
        "engineering": {"mode": "engineering"},
    }

    mode: Mode = Field(
        default="engineering",
        description="interior splats: 'paper' 1, 1.5 and 2 times as large as deep, 'engineering' never out of the soil",
    )
    placement: Placement = Field(
        default="lattice",
        description="particles in the middles of cells as in the paper, anywhere in their cells, or as blue noise",
    )
    interior_opacity: float = Field(default=0.95, gt=0, le=1, description="opacity of interior splats")
    color_neighbours: int = Field(
        default=32,
        ge=1,
        le=1000,
        description="splats whose mean colours soil that no photograph shows; 1: only the nearest one's, as the paper",
    )
    palette: tuple[tuple[Share, Share, Share], ...] = Field(
        default=(), description="sRGB colours of the soil, in patches; none: those of the surface above"
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
    margin: float = Field(
        default=0.5, ge=0.05, le=10, description="ground around the region to mesh, in lengths of its longer side"
    )
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
    standing: Standing = Field(
        default="move", description="what stands on the mass (plants, structures): it moves with it or stays in the air"
    )

    standing_width: float = Field(
        default=0.0,
        ge=0,
        le=50,
        description="trees and structures up to this wide aren't filled with soil, m; 0: all that was scanned is soil",
    )

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Read the region's files, so that a fault in them is told before anything is computed."""
        if isinstance(problem, FillingProblem):
            read_region_files(problem.region)
            if isinstance(problem.region, MeshRegion):
                closed_room(*read_mesh(problem.region.path), str(problem.region.path))

    def fill(self, survey: Survey, splats: SplatCloud, problem: FillingProblem, context: Context) -> Filling:
        """Return the soil of the region, one particle to a lattice cell, what rides on it, and what stays."""
        plan, spacing = plan_of(problem.region, survey.georeference), problem.particle_spacing
        context.progress(0, STEPS)
        support = self._support(survey, splats, plan, context)
        context.progress(1, STEPS, support_splats=len(support.centers))
        soil, grid = self._ground(support, plan, problem, survey.georeference)
        ground = ground_of(soil)
        surface = Surface(ground.vertices.astype(np.float32), ground.triangles)
        context.progress(2, STEPS, vertices=len(surface.vertices))
        self._report_support(surface, support, plan, spacing, splats, context)
        pit = _pit(soil, float(ground.vertices[:, 2].max()), problem, plan, grid, survey.georeference, context)
        bounds = _bounds(plan, pit.mass)
        positions, volumes = _particles(pit.mass, Lattice(bounds, spacing), self.placement, context)
        context.progress(3, STEPS, particles=len(positions))
        colors = self._colors(_subset(splats, support.indices), surface, survey, support.spacing, spacing, context)
        body = _body(soil.mesh())
        interior = interior_splats(positions, surface, body, spacing, self.mode, self.interior_opacity, colors)
        _tell_of_giants(interior, spacing, context)
        context.progress(4, STEPS)
        scar = scar_splats(pit.bare, surface, body, support.spacing, spacing, colors)
        moving = carriers(splats, positions, surface, plan, grid, spacing, self._moving_height(support))
        context.figure("moving_splats", int((moving != STAYS).sum()))
        context.progress(5, STEPS)
        shown, classes = _trimmed(ground, support, self._limits(support))
        terrain, _ = _trimmed(pit.terrain, support, self._limits(support))
        context.progress(STEPS, STEPS)
        return Filling(
            bounds=bounds,
            particle_positions=positions,
            particle_volumes=volumes,
            interior=interior,
            interior_particles=np.arange(len(positions), dtype=np.int32),
            surface_particles=moving,
            surface_vertices=shown.vertices.astype(np.float32),
            surface_triangles=shown.triangles,
            surface_support=classes,
            terrain_vertices=terrain.vertices.astype(np.float32),
            terrain_triangles=terrain.triangles,
            scar=scar,
        )

    def _colors(
        self,
        observed: SplatCloud,
        surface: Surface,
        survey: Survey,
        ground_spacing: float,
        spacing: float,
        context: Context,
    ) -> SoilColors:
        ground = surface.vertices
        photographed = np.full_like(ground, np.nan)
        if self.color_neighbours > 1 and not self.palette:
            photographed = photographed_colors(ground, survey, ground_spacing, spacing)
            context.figure("photographed_share", float(np.isfinite(photographed[:, 0]).mean()))
        return SoilColors(observed, ground, photographed, self.color_neighbours, self.palette)

    def _margin(self, plan: Plan) -> float:
        return self.margin * float((plan.bounds[1] - plan.bounds[0]).max())

    def _moving_height(self, support: Support) -> float:
        """Return up to which height over the ground splats move; the ground itself is a spacing or two thick."""
        thickness = GROUND_SPACINGS * support.spacing
        return max(self.standing_height, thickness) if self.standing == "move" else thickness

    def _limits(self, support: Support) -> tuple[float, float]:
        return self.observed_spacings * support.spacing, self.extrapolated_spacings * support.spacing

    def _ground(
        self, support: Support, plan: Plan, problem: FillingProblem, georeference: Georeference
    ) -> tuple[Solid, ReleaseGrid]:
        """Return the soil around the region and the slip surface in it."""
        sheet = poisson_sheet(support)
        whole = Surface(sheet[0].astype(np.float32), sheet[1])
        grid = release_grid(problem.region, plan, whole.top, problem.particle_spacing, georeference)
        margin = self._margin(plan)
        reach = widened(plan.bounds, margin)
        scanned = np.array([support.centers.min(axis=0)[:2], support.centers.max(axis=0)[:2]])
        rectangle = np.array([np.maximum(reach[0], scanned[0]), np.minimum(reach[1], scanned[1])])
        return soil_body(sheet, rectangle, float(np.nanmin(grid.base))), grid

    def _support(self, survey: Survey, splats: SplatCloud, plan: Plan, context: Context) -> Support:
        """Choose the splats of the ground around the region."""
        solid = solid_splats(splats, self.minimum_opacity, self.oversize_ratio)
        _require(len(solid), "opaque enough", self.minimum_opacity, splats)
        # the sheet is cut a little inside the splats that it rests on
        margin = 1.2 * self._margin(plan)
        near = solid[within(splats.centers[solid], widened(plan.bounds, margin))]
        if not within(splats.centers[near], plan.bounds).sum() >= LEAST_SUPPORT:
            raise outside(plan, splats, "too few splats stand over the region")
        kept = near[
            near_neighbors(splats.centers[near].astype(np.float64), self.outlier_neighbors, self.outlier_deviations)
        ]
        kept = kept[self._is_ground(splats.centers[kept].astype(np.float64), plan, context)]
        centers = splats.centers[kept].astype(np.float64)
        spacing = surface_spacing(centers)
        return Support(kept, centers, outward_normals(centers, survey, self.normal_neighbors, spacing), spacing)

    def _is_ground(self, centers: Float64Array, plan: Plan, context: Context) -> np.ndarray:
        """Tell which splats (splat, 3) aren't trees or structures, or say that such ones count as ground."""
        spacing = surface_spacing(centers)
        standing = standing_splats(centers, spacing, self.standing_width or SUSPECTED_WIDTH)
        inside = within(centers, plan.bounds)
        share = occupied_area(centers[inside & standing], spacing) / occupied_area(centers[inside], spacing)
        context.figure("standing_share", share)
        if self.standing_width:
            return ~standing
        if share > STANDING_TO_TELL:
            context.warn(
                f"{share:.0%} of the region rises abruptly from the ground, as trees and structures do, and was filled "
                f"with soil: standing_width = {SUSPECTED_WIDTH:g} in [plugins.fill_poisson] would leave it out"
            )
        return np.ones(len(centers), bool)

    def _report_support(
        self,
        surface: Surface,
        support: Support,
        plan: Plan,
        spacing: float,
        splats: SplatCloud,
        context: Context,
    ) -> None:
        """Report how much of the region's plan is seen, and refuse one that mostly isn't."""
        x, y = Lattice(np.column_stack([plan.bounds, [0.0, 1.0]]), spacing).columns()
        inside = plan.contains(x, y)
        x, y = x[inside], y[inside]
        top = surface.top(x, y)
        meshed = np.isfinite(top)
        distance = np.full(len(x), np.inf)
        distance[meshed] = distance_to(support.centers, np.column_stack([x, y, top])[meshed])
        classes = np.digitize(distance, self._limits(support), right=True)
        shares = {kind: float((classes == kind).mean()) for kind in (OBSERVED, INTERPOLATED, EXTRAPOLATED)}
        context.figure("observed_share", shares[OBSERVED])
        context.figure("interpolated_share", shares[INTERPOLATED])
        context.figure("extrapolated_share", shares[EXTRAPOLATED])
        context.figure("splat_spacing_m", support.spacing)
        if shares[EXTRAPOLATED] > self.maximum_extrapolated_share:
            raise outside(plan, splats, f"no splats support {shares[EXTRAPOLATED]:.0%} of the region")
        if not meshed.all():
            context.warn(f"{1 - meshed.mean():.1%} of the region has no surface and was left without soil")


def _pit(
    soil: Solid,
    top: float,
    problem: FillingProblem,
    plan: Plan,
    grid: ReleaseGrid,
    georeference: Georeference,
    context: Context,
) -> Excavation:
    """Cut the mass out of the soil, which reaches up to `top` metres, or say why there is none."""
    for name, value in grid.figures.items():
        context.figure(name, value)
    region = problem.region
    room = room_of(region, georeference) if isinstance(region, MeshRegion) else room_above(grid, plan, top)
    pit = excavate(soil, room)
    require_mass(pit.mass, region, plan, grid, problem.particle_spacing)
    check_particles(pit.mass.volume, problem.particle_spacing)
    return pit


def _particles(
    mass: Solid, lattice: Lattice, placement: Placement, context: Context
) -> tuple[Float32Array, Float32Array]:
    """Fill the mass, and let the particles share what is too thin for one of its own."""
    body = _body(mass.mesh())
    soil = body.stretches(*lattice.columns())
    positions, volumes = fill_body(body, soil, lattice, placement, context.seed)
    if not len(positions):
        raise too_thin(mass.volume, lattice.spacing)
    area = mass.plan_area()
    share = mass.volume / float(volumes.sum(dtype=np.float64))
    if share > RESCALING_TO_REFUSE:
        raise too_thin(mass.volume, lattice.spacing)
    context.figure("region_volume_m3", mass.volume)
    context.figure("plan_area_m2", area)
    context.figure("mean_depth_m", mass.volume / area)
    context.figure("maximum_depth_m", float(np.bincount(soil.lines, soil.tops - soil.bottoms).max()))
    context.figure("particles", len(volumes))
    context.figure("volume_rescaling_percent", 100 * (share - 1))
    if abs(share - 1) > RESCALING_TO_TELL:
        context.warn(
            f"particles {lattice.spacing:g} m apart hold {1 / share:.0%} of the mass's volume and were scaled to all "
            "of it: it is thin for them, a finer grid_spacing would tell more"
        )
    return positions, (volumes * share).astype(np.float32)


def _tell_of_giants(interior: SplatCloud, spacing: float, context: Context) -> None:
    """Say what becomes of a film of the paper's splats, which are as large as they lie deep, of a thick mass."""
    if not len(interior):
        return
    middle = float(np.median(interior.scales.max(axis=1)))
    if middle > SPACINGS_TO_TELL * spacing:
        context.warn(
            f"half of the interior's splats are over {middle:.1f} m large, and will hide the scene once the ground "
            "opens, for the paper's splats are as large as they lie deep: set mode = 'engineering' in "
            "[plugins.fill_poisson] for a film that can be looked at"
        )


def _bounds(plan: Plan, mass: Solid) -> Float64Array:
    """Return the lowest and the highest corner of the region's volume (2, 3), m."""
    heights = mass.mesh().vertices[:, 2]
    return np.column_stack([plan.bounds, [heights.min(), heights.max()]])


def _trimmed(mesh: Mesh, support: Support, limits: tuple[float, float]) -> tuple[Mesh, UInt8Array]:
    """Leave out the rim of ground that no splat supports, and return the classes of what is left (vertex,)."""
    ground = np.unique(mesh.triangles[mesh.origins == GROUND])
    classes = np.full(len(mesh.vertices), EXTRAPOLATED, np.uint8)
    classes[ground] = support_classes(mesh.vertices[ground], support, *limits)
    kept = ~unsupported_rim(mesh, classes)
    return mesh.only(kept), classes[np.unique(mesh.triangles[kept])]


def _body(mesh: Mesh) -> Body:
    return Body(mesh.vertices.astype(np.float32), mesh.triangles)


def _require(count: int, what: str, minimum_opacity: float, splats: SplatCloud) -> None:
    if count < LEAST_SUPPORT:
        raise StageFailed(
            f"only {count} of {len(splats)} splats are {what} (at least {minimum_opacity}) to make a surface",
            where="[plugins.fill_poisson] minimum_opacity",
            cure=f"lower minimum_opacity, or reconstruct more than {LEAST_SUPPORT} opaque splats",
        )


def _subset(splats: SplatCloud, indices: np.ndarray) -> SplatCloud:
    return SplatCloud(**{name: getattr(splats, name)[indices] for name in SplatCloud.array_fields()})
