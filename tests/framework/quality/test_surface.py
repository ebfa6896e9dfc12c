"""The scan's surface against ground known otherwise, on slopes whose difference is known by formula."""

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, InputError
from slideframe.problem import BoxRegion, PolygonRegion, ReferenceGround
from slideframe.problem.slip_surface import DepthBase
from slideframe.products import Filling, Georeference, SplatCloud
from slideframe.quality.surface import compare_surface, require_reference_over_region
from slideframe.quality.surface_map import ABOVE, BELOW, SAME, draw_difference
from slideframe.release.plan import plan_of
from slideframe.testing.ground_scenes import hillside_height, hillside_survey

ORIGIN = Georeference(latitude=45.0, longitude=7.0, ellipsoidal_height=300.0)
BOX = BoxRegion(x_min=-5, x_max=5, y_min=-4, y_max=4, z_min=-9)
ROUNDING = 1e-4  # m: the surface's vertices are float32, the files have six decimals


def slope(x, y):
    return 0.4 * x - 0.2 * y


def filling_of(height, reach=8.0, cells=32):
    """A filling whose surface follows a height field; nothing else of it matters here."""
    axis = np.linspace(-reach, reach, cells + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    vertices = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    return Filling(
        bounds=np.array([[-5.0, -4, -9], [5, 4, 3]]),
        particle_positions=np.zeros((1, 3), np.float32),
        particle_volumes=np.ones(1, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.zeros(0, np.int32),
        surface_particles=np.zeros(0, np.int32),
        surface_vertices=vertices.astype(np.float32),
        surface_triangles=triangles.astype(np.int32),
        surface_support=np.zeros(len(vertices), np.uint8),
    )


@pytest.fixture
def reference(tmp_path):
    """Write a height model in the local frame, its cells half a metre wide."""

    def write(height, west=-10.0, east=10.0, name="reference.asc"):
        cell, rows = 0.5, 40
        columns = round((east - west) / cell)
        x, y = west + cell * (np.arange(columns) + 0.5), -10 + cell * (np.arange(rows) + 0.5)[::-1]
        values = height(*np.meshgrid(x, y))
        header = f"ncols {columns}\nnrows {rows}\nxllcorner {west}\nyllcorner -10\ncellsize {cell}\n"
        path = tmp_path / name
        path.write_text(header + "\n".join(" ".join(f"{value:.6f}" for value in row) for row in values))
        return ReferenceGround(path=path)

    return write


def test_an_offset_is_bias_and_a_wave_is_scatter(reference):
    plan = plan_of(BOX, ORIGIN)
    same = compare_surface(filling_of(slope), plan, reference(slope), ORIGIN).figures(0.5)
    assert same["reference_rmse_m"] < ROUNDING
    assert same["reference_covered_share"] == 1
    raised = compare_surface(filling_of(lambda x, y: slope(x, y) + 0.3), plan, reference(slope), ORIGIN).figures(0.5)
    assert raised["reference_bias_m"] == pytest.approx(0.3, abs=ROUNDING)
    assert raised["reference_rmse_m"] == pytest.approx(0.3, abs=ROUNDING)
    assert raised["reference_rmse_splat_spacings"] == pytest.approx(0.6, abs=10 * ROUNDING)
    # +-0.2 in halves of the box: no bias, and a root mean square of 0.2
    halves = compare_surface(
        filling_of(lambda x, y: slope(x, y) + np.clip(4 * x, -0.2, 0.2)), plan, reference(slope), ORIGIN
    ).figures()
    assert abs(halves["reference_bias_m"]) < ROUNDING
    # between the nodes at -0.5, 0 and 0.5 the surface ramps: 10 % of the box with a third of the mean square
    assert halves["reference_rmse_m"] == pytest.approx(0.2 * np.sqrt(0.9 + 0.1 / 3), rel=0.01)
    assert "reference_rmse_splat_spacings" not in halves


def test_only_the_region_counts_and_only_what_both_have(reference):
    triangle = PolygonRegion(corners=((-4, -4), (4, -4), (4, 4)), base=DepthBase(depth=1))
    # wrong by a metre north-west of the triangle
    surface = filling_of(lambda x, y: slope(x, y) + (y > x + 1.0))
    found = compare_surface(surface, plan_of(triangle, ORIGIN), reference(slope), ORIGIN)
    assert found.figures()["reference_rmse_m"] < ROUNDING
    half = compare_surface(filling_of(slope), plan_of(BOX, ORIGIN), reference(slope, west=0.0), ORIGIN)
    assert half.covered_share == pytest.approx(0.5, abs=0.02)
    # the outermost half cell of a raster has one height: up to 0.1 m off on a slope of 0.4
    assert half.figures()["reference_rmse_m"] < 0.02
    assert np.nanmax(np.abs(half.difference[half.x > 0.25])) < ROUNDING


def test_the_highest_face_is_compared(reference):
    """Under an overhang the mesh has faces that a height model can't have."""
    ground, ledge = filling_of(lambda x, y: slope(x, y) - 2.0), filling_of(slope)
    both = ground.model_copy(
        update={
            "surface_vertices": np.concatenate([ground.surface_vertices, ledge.surface_vertices]),
            "surface_triangles": np.concatenate(
                [ground.surface_triangles, ledge.surface_triangles + np.int32(len(ground.surface_vertices))]
            ),
        }
    )
    found = compare_surface(both, plan_of(BOX, ORIGIN), reference(slope), ORIGIN).figures()
    assert found["reference_rmse_m"] < ROUNDING


def test_a_reference_on_a_map(tmp_path):
    """A slope in Hong Kong's grid, heights 2.4 m above the ellipsoid's."""
    rasterio = pytest.importorskip("rasterio")
    from slideframe.georeferencing import Heights, from_local

    origin = Georeference(latitude=22.28, longitude=114.22, ellipsoidal_height=148.4)
    middle = from_local(np.zeros((1, 3)), 2326, origin, Heights(geoid_offset=2.4))[0]
    path = tmp_path / "reference.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=60, height=60, count=1, dtype="float32", crs="EPSG:2326",
        transform=rasterio.transform.from_origin(middle[0] - 15, middle[1] + 15, 0.5, 0.5),
    ) as target:  # fmt: skip
        east = 0.5 * (np.arange(60) + 0.5) - 15
        target.write(np.broadcast_to(middle[2] + 0.4 * east, (60, 60)).astype(np.float32), 1)
    given = ReferenceGround(path=path, geoid_offset=2.4)
    found = compare_surface(filling_of(lambda x, y: 0.4 * x), plan_of(BOX, origin), given, origin).figures()
    # the grid is turned by 0.1 degrees against true north: 5 m off the middle, 0.4 * 5 * sin(0.1) = 0.4 cm
    assert found["reference_rmse_m"] < 0.01


def test_a_reference_elsewhere_or_over_a_small_part_is_refused(reference):
    survey = hillside_survey()
    require_reference_over_region(survey, BOX, reference(hillside_height))
    with pytest.raises(ConfigurationError, match="covers 20% of the region only") as caught:
        require_reference_over_region(survey, BOX, reference(hillside_height, west=3.0))
    assert "[reference_ground]" in caught.value.where
    with pytest.raises(ConfigurationError, match="no value over the region"):
        require_reference_over_region(survey, BOX, reference(hillside_height, west=40.0, east=50.0))
    with pytest.raises(InputError, match="can't be read"):
        require_reference_over_region(survey, BOX, ReferenceGround(path="nowhere.asc"))


def test_map_shows_high_red_and_low_blue(reference):
    surface = filling_of(lambda x, y: slope(x, y) + 0.1 * np.sign(x))
    picture = np.asarray(draw_difference(compare_surface(surface, plan_of(BOX, ORIGIN), reference(slope), ORIGIN)))
    west, east = picture[100:400, 70:300].reshape(-1, 3), picture[100:400, 450:680].reshape(-1, 3)
    assert (np.abs(west.astype(int) - BELOW).max(axis=1) < 3).mean() > 0.9
    assert (np.abs(east.astype(int) - ABOVE).max(axis=1) < 3).mean() > 0.9
    assert SAME not in {tuple(color) for color in west.tolist()}
