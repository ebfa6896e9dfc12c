"""Ground that breaks height fields and careless surfaces, its volume known by formula: faces, walls, gaps, trees."""

import numpy as np
import pytest

from slideframe.problem import BoxRegion, FillingProblem
from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_fill_poisson.solids import rim_edges
from slideframe_fill_poisson.standing import standing_splats

VOLUME_TOLERANCE = 0.005
SPACING, NOISE = 0.25, 0.03  # of splats, m
HALF = 12.0
OVERHANG = [(-12, 0), (0, 0), (-1.5, 6), (12, 7.35)]  # x and z: a face 6 m high that leans out by 1.5 m
TERRACES = [(-12, 0), (-2, 0), (-2, 2.5), (1, 2.5), (1, 5), (12, 6.1)]  # two retaining walls
BOX = BoxRegion(x_min=-5, x_max=5, y_min=-4, y_max=4, z_min=-1)
TREES = ((-2.0, -1.0), (2.0, 2.0), (3.0, -3.0))


def extruded(profile, generator):
    """Strew splats over a profile in x and z that runs along y."""
    corners = np.asarray(profile, float)
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    s, y = (g.ravel() for g in np.meshgrid(np.arange(0, along[-1], SPACING), np.arange(-HALF, HALF, SPACING)))
    s, y = (values + generator.uniform(-0.3, 0.3, s.size) * SPACING for values in (s, y))
    x, z = (np.interp(s, along, corners[:, axis]) for axis in range(2))
    centers = np.column_stack([x, y, z])
    return centers + generator.normal(0, NOISE, centers.shape)


def section_area(profile, low=-5.0, high=5.0, base=-1.0):
    """Return the area between a profile and the base, overhangs left hollow, m2."""
    corners = [(low, base), (high, base), (high, np.interp(high, *np.asarray(profile[-2:]).T))]
    corners += [corner for corner in profile[::-1] if low < corner[0] < high] + [(low, profile[0][1])]
    x, z = np.asarray(corners, float).T
    return abs(x @ np.roll(z, -1) - z @ np.roll(x, -1)) / 2


@pytest.fixture
def generator():
    return np.random.default_rng(3)


@pytest.fixture
def facing(survey):
    """The survey, and photographs from the west that see faces and what is under them."""
    places = [(west, north, up) for west, up in ((-12, 2), (-9, 6)) for north in (-6, -2, 2, 6)]
    poses = []
    for place in places:
        forward = np.array([0.0, place[1], 3.0]) - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        poses.append(np.column_stack([right, np.cross(forward, right), forward, place]))
    return survey.model_copy(
        update={
            "photographs": survey.photographs + survey.photographs[: len(poses)],
            "world_from_camera": np.concatenate([survey.world_from_camera, poses]),
        }
    )


@pytest.fixture
def fill(facing, make_splats, context):
    def fill(centers, region=BOX, **options):
        problem = FillingProblem(region=region, particle_spacing=0.4)
        return PoissonFiller(**options).fill(facing, make_splats(centers), problem, context)

    return fill


def volume(filling):
    return filling.particle_volumes.sum(dtype=np.float64)


def require_whole_terrain(filling):
    """Its only rim is the outer one."""
    rim = filling.terrain_vertices[np.unique(rim_edges(filling.terrain_triangles))]
    assert (np.abs(rim[:, :2]) > [5, 4]).any(axis=1).all()


@pytest.mark.parametrize("width", [0.0, 4.0], ids=["all is soil", "without things up to 4 m wide"])
@pytest.mark.parametrize("profile", [OVERHANG, TERRACES], ids=["overhang", "terraces"])
def test_faces_stand_and_stay_hollow_below(fill, context, generator, profile, width):
    filling = fill(extruded(profile, generator), standing_width=width)
    assert volume(filling) == pytest.approx(8 * section_area(profile), rel=VOLUME_TOLERANCE)
    require_whole_terrain(filling)
    assert context.figures["observed_share"] > 0.99
    if profile is OVERHANG:
        x, _, z = filling.particle_positions.T
        face = np.interp(z, [0, 6], [0, -1.5])
        assert not ((z > 0.3) & (x < face - 0.1)).any()
        assert ((z > 0.3) & (x < 0)).sum() > 100  # soil in the part that leans out


def rolling(x, y):
    return 3 + 0.4 * y + 0.3 * np.sin(0.9 * x)


def strewn(height, generator):
    axis = np.arange(-HALF, HALF, SPACING)
    x, y = (g.ravel() + generator.uniform(-0.3, 0.3, axis.size**2) * SPACING for g in np.meshgrid(axis, axis))
    return np.column_stack([x, y, height(x, y) + generator.normal(0, NOISE, x.size)])


def test_gaps_are_closed_smoothly_and_told(fill, context, generator):
    ground = strewn(rolling, generator)
    seen = (np.hypot(*(ground[:, :2] - 1).T) > 1.5) & (np.hypot(*(ground[:, :2] + [3, 2]).T) > 1.0)
    filling = fill(ground[seen])
    x, y = np.meshgrid(np.linspace(-5, 5, 401), np.linspace(-4, 4, 401))
    assert volume(filling) == pytest.approx(80 * (rolling(x, y) + 1).mean(), rel=VOLUME_TOLERANCE)
    # two discs, less a rim of two splat spacings at most that counts as observed
    most, least = (np.pi * ((1.5 - rim) ** 2 + (1.0 - rim) ** 2) / 80 for rim in (0.0, 2 * SPACING))
    inferred = context.figures["interpolated_share"] + context.figures["extrapolated_share"]
    assert least < inferred < most
    require_whole_terrain(filling)


def test_no_ground_is_invented_beyond_the_scan(fill, context, generator):
    """The scan ends in the middle of the region; the pit keeps its floor all the same."""
    ground = strewn(rolling, generator)
    filling = fill(ground[ground[:, 0] < 2])
    assert filling.particle_positions[:, 0].max() < 2.0
    assert any("has no surface" in warning for warning in context.warnings)
    floor = np.abs(filling.terrain_vertices[:, 2] + 1) < 1e-4
    assert filling.terrain_vertices[floor, 0].max() > 1.5
    corners = filling.terrain_vertices[filling.terrain_triangles]
    level = (np.abs(corners[:, :, 2] + 1) < 1e-4).all(axis=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)[level] / 2
    assert area.sum() == pytest.approx(8 * (2 + 5), rel=0.03)


def tree(east, north, generator, *, trunk=True):
    """A crown of 3 m by 2.4 m, 4 m up, on a trunk of 0.3 m."""
    way = generator.normal(size=(1500, 3))
    way *= generator.uniform(0.8, 1, (1500, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
    crown = way * [1.5, 1.5, 1.2] + [east, north, 4]
    if not trunk:
        return crown
    angle, height = generator.uniform(0, 2 * np.pi, 90), np.linspace(0, 3, 90)
    return np.concatenate([crown, np.column_stack([east + 0.15 * np.cos(angle), north + 0.15 * np.sin(angle), height])])


def level(x, y):
    return np.zeros_like(x)


def test_trees_are_not_filled_with_soil(fill, context, generator):
    trees = np.concatenate([tree(*place, generator) for place in TREES])
    filling = fill(np.concatenate([strewn(level, generator), trees]), standing_width=5.0)
    assert volume(filling) == pytest.approx(80, rel=VOLUME_TOLERANCE)
    assert filling.particle_positions[:, 2].max() < 0.1
    assert context.figures["standing_share"] == pytest.approx(3 * np.pi * 1.5**2 / 80, rel=0.3)


def test_trees_that_are_filled_are_told(fill, context, generator):
    trees = np.concatenate([tree(*place, generator) for place in TREES])
    fill(np.concatenate([strewn(level, generator), trees]))
    assert any("standing_width = 8" in warning for warning in context.warnings)


def test_a_crown_without_a_trunk_is_no_ground(fill, generator):
    """A closed part of the surface that hangs in the air is left out whatever the options."""
    crowns = np.concatenate([tree(*place, generator, trunk=False) for place in TREES])
    filling = fill(np.concatenate([strewn(level, generator), crowns]))
    assert volume(filling) == pytest.approx(80, rel=VOLUME_TOLERANCE)
    assert filling.particle_positions[:, 2].max() < 0.3


@pytest.mark.parametrize(
    "height",
    [rolling, lambda x, y: 0.8 * np.abs(x), lambda x, y: 6.0 * (x > 0.3 * y), lambda x, y: 1.2 * y],
    ids=["rolling", "roof", "cliff", "50 degrees"],
)
def test_bare_ground_has_nothing_standing(generator, height):
    ground = strewn(height, generator)
    middle = (np.abs(ground[:, :2]) < HALF - 4).all(axis=1)
    assert standing_splats(ground, SPACING, 8.0)[middle].mean() < 0.002
