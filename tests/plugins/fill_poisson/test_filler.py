"""The stage on bodies of known volume, and on input that it must refuse."""

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, StageFailed
from slideframe.problem import BoxRegion, FillingProblem, ReferenceGround
from slideframe.quality.surface import compare_surface
from slideframe.release.plan import plan_of
from slideframe_fill_poisson.filler import PoissonFiller

# The mesh follows a smooth surface to a small share of the splats' spacing; the lattice loses nothing but thin edges.
VOLUME_TOLERANCE = 0.005
# Poisson rounds an edge over about one cell (0.25 m) of the 4 m high step.
EDGE_VOLUME_TOLERANCE = 0.02
# The mesh stands off a smooth surface by less than a tenth of the splats' spacing.
SURFACE_TOLERANCE = 0.03


def slope(x, y):
    return 3 + 0.6 * y


def bumps(x, y):
    """Mean 2 over the box, radius of curvature down to 2 m, slopes to 38 degrees."""
    return 2 + 0.6 * np.sin(2 * np.pi * x / 5) * np.cos(2 * np.pi * y / 5)


@pytest.fixture
def filled(survey, make_splats, scatter, box, context):
    def fill(height, *, problem=None, **options):
        splats = make_splats(scatter(height))
        return PoissonFiller(**options).fill(survey, splats, problem or box(), context), splats

    return fill


@pytest.mark.parametrize(("height", "volume"), [(slope, 300.0), (bumps, 200.0)])
def test_volume_is_the_body_s(filled, context, height, volume):
    filling, _ = filled(height)
    total = filling.particle_volumes.sum(dtype=np.float64)
    assert total == pytest.approx(volume, rel=VOLUME_TOLERANCE)
    assert context.figures["region_volume_m3"] == pytest.approx(total, rel=1e-5)
    assert abs(context.figures["volume_rescaling_percent"]) < 100 * VOLUME_TOLERANCE
    assert context.figures["observed_share"] > 0.99
    ground = height(*filling.particle_positions[:, :2].T)
    assert (filling.particle_positions[:, 2] < ground + SURFACE_TOLERANCE).all()


def test_most_particles_have_the_volume_of_a_cell(filled):
    filling, _ = filled(slope)
    assert np.median(filling.particle_volumes) == pytest.approx(0.125, rel=VOLUME_TOLERANCE)
    assert filling.particle_volumes.min() > 0.49 * 0.125
    assert filling.particle_volumes.max() < 1.51 * 0.125


def test_mesh_looks_up_and_follows_the_ground(filled):
    filling, _ = filled(bumps)
    corners = filling.surface_vertices[filling.surface_triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).mean() > 0.999
    inside = (np.abs(filling.surface_vertices[:, :2]) < 5).all(axis=1)
    assert inside.any()
    gap = filling.surface_vertices[inside, 2] - bumps(*filling.surface_vertices[inside, :2].T)
    assert np.sqrt(np.mean(gap**2)) < SURFACE_TOLERANCE
    assert (filling.surface_support[inside] == 0).all()


def test_surface_of_noisy_splats_is_within_half_a_spacing(survey, make_splats, scatter, box, context, tmp_path):
    """Splats scatter by 0.4 spacings about the ground, as trained ones do; judged as `slideframe run` does."""
    centers = scatter(bumps)
    centers[:, 2] += np.random.default_rng(7).normal(0, 0.1, len(centers))
    problem = box()
    filling = PoissonFiller().fill(survey, make_splats(centers), problem, context)
    cell, count = 0.1, 120
    axis = -6 + cell * (np.arange(count) + 0.5)
    lines = [" ".join(f"{value:.5f}" for value in row) for row in bumps(*np.meshgrid(axis, axis[::-1]))]
    path = tmp_path / "truth.asc"
    path.write_text(f"ncols {count}\nnrows {count}\nxllcorner -6\nyllcorner -6\ncellsize {cell}\n" + "\n".join(lines))
    plan = plan_of(problem.region, survey.georeference)
    comparison = compare_surface(filling, plan, ReferenceGround(path=path), survey.georeference)
    figures = comparison.figures(context.figures["splat_spacing_m"])
    # 0.25 in plan, more along the slopes and through the scatter
    assert 0.25 < context.figures["splat_spacing_m"] < 0.3
    assert 0.02 < figures["reference_rmse_splat_spacings"] < 0.5
    assert abs(figures["reference_bias_m"]) < 0.02


def test_vertical_face_stands(survey, make_splats, box, context):
    """Ground at 0 west of x = 0 and at 4 east of it, with a wall of splats between."""
    axis = np.arange(-10, 10, 0.25)
    x, y = (grid.ravel() for grid in np.meshgrid(axis + 0.125, axis))
    wall_y, wall_z = (grid.ravel() for grid in np.meshgrid(axis, np.arange(0.125, 4, 0.25)))
    ground = np.column_stack([x, y, np.where(x > 0, 4.0, 0.0)])
    wall = np.column_stack([np.zeros(wall_y.size), wall_y, wall_z])
    filling = PoissonFiller().fill(survey, make_splats(np.concatenate([ground, wall])), box(z_min=-1.0), context)
    assert filling.particle_volumes.sum(dtype=np.float64) == pytest.approx(10 * 5 * (5 + 1), rel=EDGE_VOLUME_TOLERANCE)
    high = filling.particle_positions[filling.particle_positions[:, 2] > 0.5]
    assert high[:, 0].min() > -0.1


def test_overhang_stays_hollow(survey, make_splats, context):
    """A ledge 2 m thick, its underside 2 m over the ground, sticks out 4 m to the west of a wall at x = 2."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-10, 10, 0.2) + 0.1, np.arange(-10, 10, 0.2)))
    face_y, face_z = (grid.ravel() for grid in np.meshgrid(np.arange(-10, 10, 0.2), np.arange(0.1, 2, 0.2)))
    edge = -2.0
    top = np.column_stack([x, y, np.where(x > edge, 4.0, 0.0)])
    under = (x > edge) & (x < 2)
    parts = [
        top,
        np.column_stack([x[under], y[under], np.zeros(under.sum())]),
        np.column_stack([x[under], y[under], np.full(under.sum(), 2.0)]),
        np.column_stack([np.full(face_y.size, 2.0), face_y, face_z]),
        np.column_stack([np.full(face_y.size, edge), face_y, face_z + 2]),
    ]
    # cameras out in the west see under the ledge; those above don't see through it
    low = [np.array([-7.0, north, up]) for north in (-8, -3, 3, 8) for up in (0.4, 0.9)]
    poses = np.stack([facing(place, np.array([1.0, 0.0, 0.0])) for place in low])
    looking = survey.model_copy(
        update={
            "photographs": survey.photographs + survey.photographs[: len(low)],
            "world_from_camera": np.concatenate([survey.world_from_camera, poses]),
        }
    )
    problem = FillingProblem(region=BoxRegion(x_min=-5, x_max=5, y_min=-4, y_max=4, z_min=-1), particle_spacing=0.5)
    filling = PoissonFiller().fill(looking, make_splats(np.concatenate(parts)), problem, context)
    x, _, z = filling.particle_positions.T
    # no soil in the hollow but for rounded corners, and soil above and below it
    assert not ((x > -1.7) & (x < 1.5) & (z > 0.3) & (z < 1.7)).any()
    assert ((x > -1.7) & (x < 1.5) & (z > 2.3) & (z < 3.7)).sum() == 6 * 16 * 2
    expected = 8 * (10 * 1 + 7 * 4 - 4 * 2)
    assert filling.particle_volumes.sum(dtype=np.float64) == pytest.approx(expected, rel=EDGE_VOLUME_TOLERANCE)


def facing(place, forward):
    right = np.cross(forward, [0, 0, 1.0])
    return np.column_stack([right, np.cross(forward, right), forward, place])


def test_engineering_splats_never_leave_the_soil(filled):
    filling, _ = filled(bumps)
    interior = filling.interior
    ends = 3 * axes_of(interior)
    tips = np.concatenate([interior.centers[:, None] + ends, interior.centers[:, None] - ends], axis=1).reshape(-1, 3)
    within = (np.abs(tips[:, :2]) < 7).all(axis=1)
    assert (tips[within, 2] < bumps(*tips[within, :2].T) + SURFACE_TOLERANCE).all()
    # and they still fill: below the first layer nothing had to shrink
    depth = bumps(*interior.centers[:, :2].T) - interior.centers[:, 2]
    np.testing.assert_allclose(interior.scales[depth > 1.2][:, 1:], 0.25, rtol=1e-6)


def test_paper_splats_are_as_large_as_they_are_deep(filled):
    filling, _ = filled(slope, mode="paper")
    interior = filling.interior
    normal = np.array([0, -0.6, 1]) / np.hypot(0.6, 1)
    depth = (np.array([0, 0, 3.0]) - interior.centers) @ normal
    np.testing.assert_allclose(interior.scales, depth[:, None] * [1, 1.5, 2], atol=2 * SURFACE_TOLERANCE)
    deep = depth > 0.5
    short = axes_of(interior)[deep, 0] / interior.scales[deep, :1]
    assert (np.abs(short @ normal) > 0.99).all()
    np.testing.assert_allclose(np.linalg.norm(interior.rotations, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize(("mode", "told"), [("paper", True), ("engineering", False)])
def test_splats_that_will_hide_the_scene_are_told(filled, context, mode, told):
    filled(slope, mode=mode)
    assert any("hide the scene" in warning for warning in context.warnings) == told


def test_interior_takes_the_base_colour_of_the_nearest_splat_as_in_the_paper(filled):
    filling, splats = filled(slope, color_neighbours=1)
    assert filling.interior.harmonics.shape[1] == 1
    normal = np.array([0, -0.6, 1]) / np.hypot(0.6, 1)
    depth = (np.array([0, 0, 3.0]) - filling.interior.centers) @ normal
    # near the surface, the mesh's own waves don't lead to another splat
    shallow = np.flatnonzero((depth < 0.5) & (np.abs(filling.interior.centers) < 4).all(axis=1))
    foot = filling.interior.centers[shallow] + depth[shallow, None] * normal
    nearest = np.linalg.norm(splats.centers - foot[:, None], axis=2).argmin(axis=1)
    same = np.isclose(filling.interior.harmonics[shallow, 0], splats.harmonics[nearest, 0], rtol=1e-6).all(axis=1)
    assert same.mean() > 0.9


def test_interior_colours_fade_from_the_surface_s_into_one(filled):
    # the surface's base colours scatter with a deviation of 1; means of 32 of them with 1 / sqrt(32) = 0.18
    filling, splats = filled(slope)
    colours = filling.interior.harmonics[:, 0]
    depth = (np.array([0, 0, 3.0]) - filling.interior.centers) @ np.array([0, -0.6, 1]) / np.hypot(0.6, 1)
    deep = depth > 4
    assert deep.any()
    # lumps vary less than the surface's means do, about one colour, which is less green than the surface
    variety, means = colours[deep].std(axis=0).mean(), splats.harmonics[:, 0].std() / 32**0.5
    assert 0.2 * means < variety < means
    assert (colours[deep] @ [-1, 2, -1]).mean() < (splats.harmonics[:, 0] @ [-1, 2, -1]).mean() - 0.1
    # a quarter metre down, 78 % of the means' scatter of 0.18 is left, beside that of the lumps
    shallow = np.abs(depth - 0.25) < 0.2
    assert colours[shallow].std(axis=0).mean() == pytest.approx(np.hypot(0.78 * means, variety), rel=0.2)


def test_palette_colours_the_soil(filled):
    palette = ((0.5, 0.3, 0.2), (0.6, 0.45, 0.3))
    filling, _ = filled(slope, palette=palette)
    for cloud in (filling.interior, filling.scar):
        colours = 0.5 + 0.28209479177387814 * cloud.harmonics[:, 0]
        chosen = np.abs(colours[:, None] - np.array(palette)).max(axis=2)
        assert chosen.min(axis=1).max() < 1e-6
        assert 0.3 < (chosen.argmin(axis=1) == 0).mean() < 0.7


def axes_of(splats):
    """Return the splats' axes times their scales (splat, axis, 3)."""
    w, x, y, z = splats.rotations.astype(np.float64).T
    columns = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(columns), -1, 0) * splats.scales[:, :, None]


def test_what_moves(survey, make_splats, scatter, box, context):
    ground = scatter(slope)
    # a plant's tip, a bird, a splat below the base, one outside the plan
    extra = np.array([[1.0, 1.0, slope(1, 1) + 2], [1, 1, slope(1, 1) + 8], [0, 0, -0.5], [5.5, 0, 3]])
    splats = make_splats(np.concatenate([ground, extra]))
    filling = PoissonFiller().fill(survey, splats, box(), context)
    moving = filling.surface_particles
    assert moving[-4] >= 0
    assert (moving[-3:] == -1).all()
    inside = (np.abs(ground[:, :2]) < 4.9).all(axis=1) & (ground[:, 2] > 0.5)
    carried = moving[:-4][inside]
    assert (carried >= 0).all()
    reach = np.linalg.norm(filling.particle_positions[carried] - ground[inside], axis=1)
    assert reach.max() < 0.5 * np.sqrt(3)
    assert context.figures["moving_splats"] == (moving >= 0).sum()


def test_haze_floaters_and_giants_do_not_shape_the_ground(survey, make_splats, scatter, box, context):
    generator = np.random.default_rng(5)
    ground = scatter(slope)
    haze = generator.uniform([-9, -9, 6], [9, 9, 12], (300, 3))
    floaters = generator.uniform([-9, -9, 12], [9, 9, 25], (25, 3))
    giants = generator.uniform([-4, -4, 6], [4, 4, 7], (40, 3))
    centers = np.concatenate([ground, haze, floaters, giants])
    opacity = np.full(len(centers), 0.9)
    opacity[len(ground) : len(ground) + 300] = 0.05
    splats = make_splats(centers, opacity=opacity)
    scales = splats.scales.copy()
    scales[-40:] = 3.0
    filling = PoissonFiller().fill(survey, splats.model_copy(update={"scales": scales}), box(), context)
    assert filling.particle_volumes.sum(dtype=np.float64) == pytest.approx(300, rel=VOLUME_TOLERANCE)


def test_same_input_gives_the_same_bits(filled):
    first, _ = filled(bumps)
    second, _ = filled(bumps)
    assert first == second


def test_hole_is_reported_as_inferred(survey, make_splats, scatter, box, context):
    ground = scatter(slope)
    ground = ground[np.hypot(ground[:, 0], ground[:, 1]) > 2.5]
    filling = PoissonFiller().fill(survey, make_splats(ground), box(), context)
    middle = np.hypot(*filling.surface_vertices[:, :2].T) < 0.4
    assert middle.any()
    assert (filling.surface_support[middle] == 2).all()
    share = context.figures["interpolated_share"] + context.figures["extrapolated_share"]
    # the hole less the ring within two spacings of its rim; the rim's splats stand 0.1 m behind it on average
    assert share == pytest.approx(np.pi * (2.6 - 0.5) ** 2 / 100, rel=0.2)


@pytest.mark.parametrize(
    ("region", "where"),
    [
        ({"x_min": 40, "x_max": 50, "y_min": -5, "y_max": 5, "z_min": 0}, "x_min, x_max, y_min, y_max"),
        ({"x_min": -5, "x_max": 5, "y_min": -5, "y_max": 40, "z_min": 0}, "x_min, x_max, y_min, y_max"),
        ({"x_min": -5, "x_max": 5, "y_min": -5, "y_max": 5, "z_min": 30}, "z_min"),
    ],
    ids=["elsewhere", "mostly beyond the scene", "above the ground"],
)
def test_region_without_ground_is_refused(filled, region, where):
    problem = FillingProblem(region=BoxRegion(**region), particle_spacing=0.5)
    with pytest.raises(ConfigurationError) as caught:
        filled(slope, problem=problem)
    assert where in caught.value.where
    assert caught.value.cure
    if "x_min" in where:
        assert "x -10.0 to 9.7" in caught.value.cure  # the scene's extent, 1 % cut off


@pytest.mark.parametrize(("count", "opacity"), [(6400, 0.05), (60, 0.9)], ids=["all faint", "too few"])
def test_too_little_to_make_a_surface(survey, make_splats, scatter, box, context, count, opacity):
    splats = make_splats(scatter(slope)[:count], opacity=opacity)
    with pytest.raises(StageFailed, match="opaque enough") as caught:
        PoissonFiller().fill(survey, splats, box(), context)
    assert "minimum_opacity" in caught.value.where
