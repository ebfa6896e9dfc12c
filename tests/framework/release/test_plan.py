"""Plans of regions given in any coordinates, and outlines that must be refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.errors import ConfigurationError, InputError
from slideframe.georeferencing import from_local
from slideframe.pipeline import require_region_in_survey
from slideframe.problem import BoxRegion, FlatBase, PolygonRegion
from slideframe.products import Georeference
from slideframe.release.plan import plan_of
from slideframe.survey_folder import plan_bounds
from slideframe.testing.ground_scenes import hillside_survey

BASE = FlatBase(z_min=-10)
OUTLINE = np.array([[-20.0, -10], [30, -10], [30, 25], [-20, 25]])
SPARSE = ("sparse_points", "sparse_colors", "sparse_errors")
HOLE = np.array([[0.0, 0], [8, 0], [8, 6], [0, 6]])
AREA = 50 * 35 - 48


def test_corners_and_holes(georeference):
    plan = plan_of(PolygonRegion(corners=OUTLINE.tolist(), holes=[HOLE.tolist()], base=BASE), georeference)
    assert plan.area == pytest.approx(AREA)
    np.testing.assert_array_equal(plan.bounds, [[-20, -10], [30, 25]])
    np.testing.assert_array_equal(plan.contains(np.array([-5.0, 4, 40]), np.array([3.0, 3, 3])), [True, False, False])


@pytest.mark.parametrize("crs", [None, "urn:ogc:def:crs:EPSG::2326", "EPSG:2326"])
def test_geojson_in_degrees_and_on_a_map(georeference, to_map, write_geojson, crs):
    rings = [to_map(ring, 4326 if crs is None else 2326) for ring in (OUTLINE, HOLE)]
    plan = plan_of(PolygonRegion(path=write_geojson(rings, crs), base=BASE), georeference)
    np.testing.assert_allclose(plan.bounds, [[-20, -10], [30, 25]], atol=0.01)
    assert plan.area == pytest.approx(AREA, rel=1e-3)


@pytest.mark.parametrize("suffix", [".gpkg", ".shp"])
def test_geopackage_and_shapefile(georeference, to_map, tmp_path, suffix):
    pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
    polygon = shapely.Polygon(to_map(OUTLINE), [to_map(HOLE)])
    path = tmp_path / f"outline{suffix}"
    pyogrio.raw.write(
        path, shapely.to_wkb(np.array([polygon])), [np.array([1])], ["number"], geometry_type="Polygon", crs="EPSG:2326"
    )
    plan = plan_of(PolygonRegion(path=path, base=BASE), georeference)
    np.testing.assert_allclose(plan.bounds, [[-20, -10], [30, 25]], atol=0.01)
    assert plan.area == pytest.approx(AREA, rel=1e-3)


def test_several_polygons_are_united(georeference, tmp_path):
    square = [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]
    shifted = [[[x + 0.5, y] for x, y in square[0]]]
    path = tmp_path / "many.geojson"
    crs = '"crs": {"type": "name", "properties": {"name": "EPSG:2326"}}'
    path.write_text(f'{{"type": "MultiPolygon", "coordinates": {[square, shifted]}, {crs}}}')
    region = PolygonRegion(path=path, base=BASE)
    with pytest.raises(InputError):  # near the corner of the map, far from the survey
        plan_of(region, georeference)
    origin = np.array([834000.0, 816000.0])
    moved = [[[(np.array(corner) + origin).tolist() for corner in part[0]]] for part in (square, shifted)]
    path.write_text(f'{{"type": "MultiPolygon", "coordinates": {moved}, {crs}}}')
    assert plan_of(region, georeference).area == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(
    ("corners", "holes", "fault"),
    [
        ([(0, 0), (4, 4), (4, 0), (0, 4)], [], "crosses itself near \\(2, 2\\)"),
        ([(0, 0), (4, 0), (0, 0)], [], "has 2 different corners"),
        ([(0, 0), (2, 2), (5, 5)], [], "on one line"),
        ([(0, 0), (4, 0), (4, 4)], [[(9, 9), (10, 9), (10, 10)]], "hole outside"),
        ([(0, 0), (4, 0), (4, 4)], [[(1, 1), (1, 1), (1, 1)]], "hole that encloses nothing"),
    ],
)
def test_unsound_outlines_are_refused(corners, holes, fault):
    with pytest.raises(ValueError, match=fault):
        PolygonRegion(corners=corners, holes=holes, base=BASE)


def test_a_crossing_outline_in_a_file_names_the_file(georeference, write_geojson):
    path = write_geojson([[(114, 22), (114.01, 22.01), (114.01, 22), (114, 22.01)]])
    with pytest.raises(ConfigurationError, match="crosses itself") as caught:
        plan_of(PolygonRegion(path=path, base=BASE), georeference)
    assert caught.value.where == str(path)


def test_corners_and_path_exclude_each_other(tmp_path):
    with pytest.raises(ValueError, match="corners or path"):
        PolygonRegion(base=BASE)
    with pytest.raises(ValueError, match="corners or path"):
        PolygonRegion(corners=OUTLINE.tolist(), path=tmp_path, base=BASE)


def test_map_coordinates_without_their_system_are_recognised(georeference, to_map):
    with pytest.raises(ConfigurationError, match="looks like a map's coordinates") as caught:
        plan_of(PolygonRegion(corners=to_map(OUTLINE).tolist(), base=BASE), georeference)
    assert "epsg" in caught.value.cure


def test_degrees_taken_for_metres_hold_no_ground():
    survey = hillside_survey()
    corners = [(114.2, 22.3), (114.3, 22.3), (114.3, 22.4)]
    with pytest.raises(ConfigurationError, match="holds no ground"):
        require_region_in_survey(survey, PolygonRegion(corners=corners, base=BASE))


@pytest.mark.parametrize("epsg", [4326, 2326])
def test_swapped_map_axes_are_recognised(epsg):
    survey = hillside_survey()
    placed = from_local(np.column_stack([OUTLINE / 5, np.zeros(4)]), epsg, survey.georeference)
    require_region_in_survey(survey, PolygonRegion(corners=placed[:, :2].tolist(), epsg=epsg, base=BASE))
    region = PolygonRegion(corners=placed[:, 1::-1].tolist(), epsg=epsg, base=BASE)
    with pytest.raises((ConfigurationError, InputError)) as caught:
        require_region_in_survey(survey, region)
    assert "before y" in caught.value.cure


def test_swapped_local_axes_are_recognised():
    survey = hillside_survey()  # 24 m wide
    swapped = BoxRegion(x_min=-9, x_max=-5, y_min=30, y_max=34, z_min=-10)
    with pytest.raises(ConfigurationError, match="holds no ground"):
        require_region_in_survey(survey, swapped)
    narrow = survey.model_copy(
        update={name: getattr(survey, name)[np.abs(survey.sparse_points[:, 0]) < 4] for name in SPARSE}
    )
    require_region_in_survey(narrow, BoxRegion(x_min=-2, x_max=2, y_min=6, y_max=10, z_min=-10))
    with pytest.raises(ConfigurationError, match="axes are swapped"):
        require_region_in_survey(narrow, BoxRegion(y_min=-2, y_max=2, x_min=6, x_max=10, z_min=-10))


def test_a_base_above_the_ground_is_refused():
    with pytest.raises(ConfigurationError, match=r"the base \(from 50.00 m up\) isn't below the ground") as caught:
        require_region_in_survey(hillside_survey(), BoxRegion(x_min=-2, x_max=2, y_min=-2, y_max=2, z_min=50))
    assert caught.value.where == "region.z_min"


@given(st.tuples(*[st.floats(0.1, 10)] * 2), st.tuples(*[st.floats(-100, 100)] * 2))
def test_a_box_is_its_own_plan(size, corner):
    origin = Georeference(latitude=0, longitude=0, ellipsoidal_height=0)
    region = BoxRegion(x_min=corner[0], x_max=corner[0] + size[0], y_min=corner[1], y_max=corner[1] + size[1], z_min=0)
    plan = plan_of(region, origin)
    assert plan.area == pytest.approx(size[0] * size[1], rel=1e-6)
    assert plan.contains(np.array([corner[0] + size[0] / 2]), np.array([corner[1] + size[1] / 2])).all()


def test_the_survey_is_judged_where_the_region_lies(georeference, to_map, tmp_path):
    region = PolygonRegion(corners=to_map(OUTLINE).tolist(), epsg=2326, base=BASE)
    np.testing.assert_allclose(plan_bounds(region, georeference), [-20, 30, -10, 25], atol=0.01)
    assert plan_bounds(None, georeference) is None
    assert plan_bounds(PolygonRegion(path=tmp_path / "none.geojson", base=BASE), georeference) is None


def test_a_file_with_swapped_axes_is_named(georeference, write_geojson):
    path = write_geojson([[(22.28, 114.21), (22.29, 114.21), (22.29, 114.22)]])  # latitude first
    with pytest.raises(InputError, match=r"lies at 114\.2") as caught:
        plan_of(PolygonRegion(path=path, base=BASE), georeference)
    assert caught.value.where == str(path)
    assert "before y" in caught.value.cure
