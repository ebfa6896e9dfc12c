"""The stage on regions of every kind, and on those that hold nothing."""

import numpy as np
import pytest

from slideframe import guards
from slideframe.errors import ConfigurationError
from slideframe.problem import (
    BoxRegion,
    DepthBase,
    EllipsoidBase,
    FillingProblem,
    FlatBase,
    MeshRegion,
    PlaneBase,
    PolygonRegion,
    SlblBase,
)
from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_fill_poisson.solids import rim_edges

VOLUME_TOLERANCE = 0.005
SURFACE_TOLERANCE = 0.03
ANGLE = 2 * np.pi * np.arange(90) / 90
CIRCLE = 5 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
SIDES = {"x_min": -4.0, "x_max": 4.0, "y_min": -4.0, "y_max": 4.0}


def slope(x, y):
    return 3 + 0.6 * y


@pytest.fixture
def filled(survey, make_splats, scatter, context):
    def fill(region, *, spacing=0.3, **options):
        splats = make_splats(scatter(slope, spacing=0.3))
        problem = FillingProblem(region=region, particle_spacing=spacing)
        return PoissonFiller(**options).fill(survey, splats, problem, context)

    return fill


def test_a_circle_on_a_plane_slope_slides_on_a_paraboloid(filled, context):
    """pi z_max L^2 / 8, through splats, surface, solution, cut and particles."""
    filling = filled(PolygonRegion(corners=CIRCLE.tolist(), base=SlblBase(maximum_depth=2.0)), spacing=0.25)
    expected = np.pi * 2 * 10**2 / 8
    assert context.figures["region_volume_m3"] == pytest.approx(expected, rel=0.02)
    assert context.figures["maximum_depth_m"] == pytest.approx(2, rel=0.02)
    assert context.figures["plan_area_m2"] == pytest.approx(np.pi * 25, rel=0.02)
    total = filling.particle_volumes.sum(dtype=np.float64)
    assert total == pytest.approx(context.figures["region_volume_m3"], rel=1e-5)
    x, y, z = filling.particle_positions.T
    depth = slope(x, y) - z
    assert (depth < 2 * (1 - (x**2 + y**2) / 25) + SURFACE_TOLERANCE).all()
    assert (np.hypot(x, y) < 5).all()


def test_constant_depth_in_a_polygon_with_a_hole(filled, context):
    hole = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    filling = filled(PolygonRegion(corners=CIRCLE.tolist(), holes=[hole], base=DepthBase(depth=1.2)))
    area = 90 / 2 * 25 * np.sin(2 * np.pi / 90) - 4
    assert context.figures["plan_area_m2"] == pytest.approx(area, rel=0.002)
    assert context.figures["region_volume_m3"] == pytest.approx(1.2 * area, rel=VOLUME_TOLERANCE)
    x, y, z = filling.particle_positions.T
    assert not ((np.abs(x) < 1) & (np.abs(y) < 1)).any()
    assert (slope(x, y) - z < 1.2 + SURFACE_TOLERANCE).all()
    # the island in the hole is ground that stays, and its sides are scar
    vertices = filling.terrain_vertices
    assert len(vertices[(np.abs(vertices[:, :2]) < 0.9).all(axis=1)])
    assert (np.abs(filling.scar.centers[:, :2]).max(axis=1) < 1.3).any()


def test_plane_and_ellipsoid(filled, context):
    plane = PlaneBase(points=[(0, -4, 0.6), (0, 4, 2.0), (4, -4, 0.6)])  # meets the ground at y = -4
    filled(BoxRegion(**SIDES, base=plane))
    # thickness (3 + 0.6 y) - (1.3 + 0.175 y), positive from y = -4 on: 8 * integral = 8 * 8 * 1.7
    assert context.figures["region_volume_m3"] == pytest.approx(8 * 8 * 1.7, rel=0.01)
    # a sphere of radius 5 about (0, 0, 3 + 3.5): the part under the slope is a cap
    centre, radius = np.array([0, 0, 6.5]), 5.0
    points = [centre + radius * np.array(d) for d in ([0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0])]
    filled(BoxRegion(x_min=-6, x_max=6, y_min=-6, y_max=6, base=EllipsoidBase(points=points, axis_ratio=(1, 1, 1))))
    away = 3.5 / np.hypot(1, 0.6)
    height = radius - away
    assert context.figures["region_volume_m3"] == pytest.approx(np.pi * height**2 * (radius - height / 3), rel=0.02)


def write_block(path, *, closed=True, low=-1.0, high=9.0, half=3.0):
    corners = [(x, y, z) for z in (low, high) for y in (-half, half) for x in (-half, half)]
    quads = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (2, 4, 8, 6), (4, 3, 7, 8)] + [(3, 1, 5, 7)] * closed
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in quads]
    path.write_text("\n".join(lines))
    return path


def test_closed_mesh(filled, context, tmp_path):
    filling = filled(MeshRegion(path=write_block(tmp_path / "block.obj")))
    assert context.figures["region_volume_m3"] == pytest.approx(36 * 4, rel=VOLUME_TOLERANCE)
    assert filling.bounds[0, 2] == pytest.approx(-1)
    rim = filling.terrain_vertices[np.unique(rim_edges(filling.terrain_triangles))]
    assert (np.abs(rim[:, :2]).max(axis=1) > 5).all()
    assert len(filling.scar)


def test_open_mesh_is_refused_with_its_place(filled, tmp_path):
    path = write_block(tmp_path / "open.obj", closed=False)
    with pytest.raises(ConfigurationError, match=r"isn't closed: 4 edges .* near \(") as caught:
        filled(MeshRegion(path=path))
    assert caught.value.where == str(path)


@pytest.mark.parametrize(
    ("region", "what"),
    [
        (BoxRegion(**SIDES, base=FlatBase(z_min=30)), "no soil lies between the base 30.00 m"),
        (BoxRegion(**SIDES, base=PlaneBase(points=[(0, 0, 9), (1, 0, 9), (0, 1, 9.6)])), "no soil lies between"),
        (BoxRegion(**SIDES, base=DepthBase(depth=0.0005)), "too thin for particles 0.3 m apart"),
        (BoxRegion(**SIDES, base=DepthBase(depth=0.05)), "too thin for particles 0.3 m apart"),
        (BoxRegion(x_min=0, x_max=0.02, y_min=0, y_max=0.02, z_min=0), "too few splats stand over the region"),
    ],
    ids=["flat base above", "plane above", "zero thickness", "a sixth of a particle", "too small"],
)
def test_regions_without_a_mass(filled, region, what):
    with pytest.raises(ConfigurationError, match=what) as caught:
        filled(region)
    assert caught.value.cure


def test_more_particles_than_memory_holds_are_refused_before_they_are_laid(filled, monkeypatch):
    monkeypatch.setattr(guards, "available_memory", lambda: 500_000_000)
    with pytest.raises(ConfigurationError, match=r"need at least 0\.8 GB: more than the 0\.5 GB") as caught:
        filled(BoxRegion(**SIDES, base=DepthBase(depth=1.0)), spacing=0.02)
    assert caught.value.where == "simulation.grid_spacing"


def test_a_mass_too_thin_for_its_particles_is_told(filled, context):
    filled(BoxRegion(**SIDES, base=PlaneBase(points=[(0, -4, 0.55), (4, -4, 0.55), (0, 4, 4.9)])), spacing=0.4)
    assert any("thin" in warning for warning in context.warnings)


def test_what_stands_on_the_mass_moves_or_stays(filled, survey, make_splats, scatter, box, context):
    ground = scatter(slope, spacing=0.3)
    tree = np.column_stack([np.full(8, 1.0), np.full(8, 1.0), slope(1, 1) + np.linspace(1, 2.8, 8)])
    splats = make_splats(np.concatenate([ground, tree]))
    moving = PoissonFiller().fill(survey, splats, box(half=4.0), context).surface_particles
    assert (moving[-8:] >= 0).all()
    staying = PoissonFiller(standing="stay").fill(survey, splats, box(half=4.0), context).surface_particles
    assert (staying[-8:] == -1).all()
    np.testing.assert_array_equal(staying[:-8], moving[:-8])
