"""What every volume filler must hold, on a hillside known by formula."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from slideframe.products import Filling
from slideframe.stages import VolumeFiller
from slideframe.testing.evidence import assert_same, assert_valid, digest, fresh_context
from slideframe.testing.ground_scenes import (
    HILLSIDE_BASE,
    HILLSIDE_BOX,
    hillside_height,
    hillside_problem,
    hillside_splats,
    hillside_survey,
)

# A smooth surface through noisy splats may run this far above the true one, in particle spacings.
SURFACE_TOLERANCE = 0.6
# One layer of lattice cells is cut by the surface; the true volume is known by quadrature.
VOLUME_TOLERANCE = 0.05


def check_filling_is_valid(stage: VolumeFiller, scratch: Path) -> None:
    """The filling has the declared arrays, and one carrier for every reconstructed splat."""
    filling = _filling(stage)
    assert_valid(filling)
    followed, splats = len(filling.surface_particles), len(hillside_splats())
    assert followed == splats, f"surface_particles speaks of {followed} splats, but {splats} were given"
    assert (filling.particle_volumes > 0).all(), "a particle has no volume"


def check_particles_are_within_the_region(stage: VolumeFiller, scratch: Path) -> None:
    """Every particle lies between the region's walls, above its base and below the ground."""
    region, positions = HILLSIDE_BOX, _filling(stage).particle_positions.astype(np.float64)
    assert len(positions), "the filling is empty"
    low = positions >= [region.x_min, region.y_min, HILLSIDE_BASE]
    high = positions[:, :2] <= [region.x_max, region.y_max]
    assert low.all(), "a particle is outside the region"
    assert high.all(), "a particle is outside the region"
    above = (positions[:, 2] - hillside_height(positions[:, 0], positions[:, 1])).max()
    limit = SURFACE_TOLERANCE * hillside_problem().particle_spacing
    assert above <= limit, f"a particle is {above:.3f} m above the ground"


def check_volume_is_that_of_the_ground(stage: VolumeFiller, scratch: Path) -> None:
    """The particles' volumes add up to the soil between base and surface."""
    region = HILLSIDE_BOX
    x, y = np.meshgrid(np.linspace(region.x_min, region.x_max, 401), np.linspace(region.y_min, region.y_max, 401))
    area = (region.x_max - region.x_min) * (region.y_max - region.y_min)
    expected = area * float((hillside_height(x, y) - HILLSIDE_BASE).mean())
    got = float(_filling(stage).particle_volumes.sum(dtype=np.float64))
    assert abs(got / expected - 1) <= VOLUME_TOLERANCE, f"the soil has {got:.1f} m3, the ground {expected:.1f} m3"


def check_interior_is_below_the_ground(stage: VolumeFiller, scratch: Path) -> None:
    """Inferred splats start near the particles that carry them."""
    filling = _filling(stage)
    carriers = filling.particle_positions[filling.interior_particles]
    away = np.linalg.norm(filling.interior.centers - carriers, axis=1)
    assert (filling.interior_particles >= 0).all(), "an inferred splat has no carrier"
    assert away.size, "there are no inferred splats"
    limit = 2 * hillside_problem().particle_spacing
    assert away.max() <= limit, f"an inferred splat starts {away.max():.2f} m from its carrier"


def check_surface_covers_the_region(stage: VolumeFiller, scratch: Path) -> None:
    """The surface mesh exists, refers to its own vertices, and follows the ground within the region."""
    filling, region = _filling(stage), HILLSIDE_BOX
    vertices = filling.surface_vertices.astype(np.float64)
    assert len(filling.surface_triangles), "the surface has no triangles"
    assert filling.surface_triangles.min() >= 0, "a triangle has a negative vertex"
    assert filling.surface_triangles.max() < len(vertices), "a triangle names a vertex that isn't there"
    inside = (np.abs(vertices[:, 0]) < region.x_max) & (np.abs(vertices[:, 1]) < region.y_max) & (vertices[:, 2] > 1)
    away = np.abs(vertices[inside, 2] - hillside_height(vertices[inside, 0], vertices[inside, 1]))
    limit = SURFACE_TOLERANCE * hillside_problem().particle_spacing
    assert inside.any(), "no vertex lies within the region"
    assert np.median(away) <= limit, f"the surface is {np.median(away):.2f} m off the ground"


def check_input_is_untouched(stage: VolumeFiller, scratch: Path) -> None:
    """The splats have the same bits after filling."""
    splats = hillside_splats()
    before = digest(splats)
    stage.fill(hillside_survey(), splats, hillside_problem(), fresh_context(scratch))
    assert digest(splats) == before, "the filler wrote into the splats' arrays"


def check_two_runs_are_equal(stage: VolumeFiller, scratch: Path) -> None:
    """Filling the same ground again gives the same bits."""
    again = stage.fill(hillside_survey(), hillside_splats(), hillside_problem(), fresh_context(scratch))
    assert_same(_filling(stage), again, "second run")


@cache
def _filling(stage: VolumeFiller) -> Filling:
    """Fill once and let all checks look at the result."""
    with tempfile.TemporaryDirectory(prefix="slideframe-check-") as folder:
        return stage.fill(hillside_survey(), hillside_splats(), hillside_problem(), fresh_context(Path(folder)))
