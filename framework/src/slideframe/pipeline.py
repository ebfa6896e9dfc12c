"""The five lines: photographs to moving pictures."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from slideframe.bench import Bench, Keyed
from slideframe.config import RunConfig
from slideframe.contact import require_at_site
from slideframe.crew import Crew
from slideframe.errors import ConfigurationError
from slideframe.guards import check_volume
from slideframe.problem import Boundary, OrbitView, Region, Simulation, SimulationProblem, View
from slideframe.products import Picture, Survey
from slideframe.quality.surface import require_reference_over_region
from slideframe.release.coverage import require_base_below, require_walls_around, volume_under
from slideframe.release.plan import plan_of, swapped_plan
from slideframe.stages import Solver

# Shares of the film at which the camera's way is checked.
LOOKS_ON_THE_WAY = 21
# Of the volume under sparse points, what the mass surely has.
SURE_SHARE = 0.5


def run(config: RunConfig, crew: Crew, bench: Bench) -> Keyed[Sequence[Picture]]:
    """Carry the survey to moving pictures; every arrow points down."""
    survey = bench.step(crew.pose_source.locate, config.site)
    bench.check(require_region_in_survey, survey, config.region)
    bench.check(require_mass_within_walls, survey, config.region, config.boundary)
    bench.check(partial(require_room_for_mass, crew.solver), survey, config.region, config.simulation)
    bench.check(require_view_of_survey, survey, config.view)
    bench.check(require_bodies_at_site, survey, config.boundary)
    if config.reference_ground is not None:
        bench.check(require_reference_over_region, survey, config.region, config.reference_ground)
    splats = bench.step(crew.reconstructor.reconstruct, survey)
    filling = bench.step(crew.volume_filler.fill, survey, splats, config.filling_problem)
    motion = bench.step(crew.solver.solve, filling, _placed(config.simulation_problem, survey))
    return bench.step(crew.renderer.render, survey, splats, filling, motion, config.view)  # type: ignore[arg-type]


def _placed(problem: SimulationProblem, survey: Keyed[Survey]) -> SimulationProblem:
    """Return the problem with its frame's origin where it needs that; a survey that isn't there yet has none."""
    known = problem.needs_georeference and survey.entry.is_whole
    return problem.placed(survey.value.georeference) if known else problem


def require_bodies_at_site(survey: Survey, boundary: Boundary) -> None:
    """Refuse the boundary's meshes where they are nowhere near what the survey saw.

    Raises:
        ConfigurationError, InputError, MissingDependency: as `require_at_site`.
    """
    require_at_site(boundary, survey.georeference, survey.sparse_points)


def require_region_in_survey(survey: Survey, region: Region) -> None:
    """Refuse a region without a single sparse point, or with a base above them, before hours are spent on splats.

    Raises:
        ConfigurationError: with the extent that the survey covers, and whether the axes are swapped.
        InputError, MissingDependency: a file of the region can't be read.
    """
    points = survey.sparse_points
    if not len(points):
        return
    plan = plan_of(region, survey.georeference)
    inside = plan.contains(points[:, 0], points[:, 1])
    if inside.any():
        require_base_below(region, plan, points[inside], survey.georeference)
        return
    low, high = np.percentile(points, [1, 99], axis=0)
    (west, south), (east, north) = plan.bounds
    swapped = swapped_plan(region, survey.georeference, points)
    what = "'s axes are swapped: with y before x it would hold ground" if swapped else " holds no ground"
    raise ConfigurationError(
        f"the region{what} that the survey saw: it spans x {west:.1f} to {east:.1f}, y {south:.1f} to {north:.1f} m",
        where="region",
        cure=("write x (easting or longitude) before y (northing or latitude); " if swapped else "")
        + f"the survey covers x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}, "
        f"z {low[2]:.1f} to {high[2]:.1f} m east, north and up of its origin",
    )


def require_mass_within_walls(survey: Survey, region: Region, boundary: Boundary) -> None:
    """Refuse walls that stand in the mass.

    Raises:
        ConfigurationError: as `require_walls_around`.
    """
    require_walls_around(region, plan_of(region, survey.georeference), boundary.domain, survey.sparse_points)


def require_room_for_mass(solver: Solver, survey: Survey, region: Region, simulation: Simulation) -> None:
    """Refuse a grid whose particles memory can't hold, by the volume under the survey's sparse points.

    Raises:
        ConfigurationError: half of that volume is already too much.
    """
    volume = volume_under(region, plan_of(region, survey.georeference), survey.sparse_points, survey.georeference)
    check_volume(SURE_SHARE * volume, simulation, solver.least_memory)


def require_view_of_survey(survey: Survey, view: View) -> None:
    """Refuse a camera that somewhere on its way sees nothing of the survey; an orbit looks at the region by itself.

    Raises:
        ConfigurationError: with what the survey covers.
        InputError: there is no photograph, file or view of a name.
    """
    points = survey.sparse_points.astype(np.float64)
    if isinstance(view, OrbitView) or not len(points):
        return
    low, high = np.percentile(points, [1, 99], axis=0)
    shot = view.shot(survey, np.stack([low, high]))
    for share in np.linspace(0, 1, LOOKS_ON_THE_WAY):
        camera, pose = shot(float(share))
        local = (points - pose[:, 3]) @ pose[:, :3]
        x, y, z = local[local[:, 2] > 0].T
        u, v = camera.focal_x * x / z + camera.principal_x, camera.focal_y * y / z + camera.principal_y
        if not ((u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)).any():
            place = ", ".join(f"{number:.1f}" for number in pose[:, 3])
            raise ConfigurationError(
                f"the camera sees nothing of the survey when {share:.0%} of the film has passed, from ({place}) m",
                where="view",
                cure=f"the survey covers x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}, "
                f"z {low[2]:.1f} to {high[2]:.1f} m east, north and up of its origin",
            )
