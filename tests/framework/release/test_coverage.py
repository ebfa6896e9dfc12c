"""Regions judged before there is a surface."""

import numpy as np
import pytest

from slideframe import guards
from slideframe.errors import ConfigurationError, InputError
from slideframe.pipeline import require_mass_within_walls, require_region_in_survey, require_room_for_mass
from slideframe.problem import (
    Boundary,
    BoxRegion,
    DepthBase,
    Domain,
    EarlierGroundBase,
    MeshBase,
    MeshRegion,
    PlaneBase,
    PolygonRegion,
    RasterBase,
)
from slideframe.reference.solver import ReferenceSolver
from slideframe.release.coverage import read_region_files, volume_under
from slideframe.release.plan import plan_of
from slideframe.testing.ground_scenes import hillside_survey
from slideframe.testing.solver_scenes import sand_problem

SIDES = {"x_min": -4.0, "x_max": 4.0, "y_min": -4.0, "y_max": 4.0}  # the hillside is about 5 m up here


@pytest.mark.parametrize(
    "region",
    [
        BoxRegion(**SIDES, z_min=30),
        BoxRegion(**SIDES, base=PlaneBase(points=[(0, 0, 9), (1, 0, 9), (0, 1, 9)])),
    ],
    ids=["flat", "plane"],
)
def test_a_base_above_the_ground_is_refused(region):
    with pytest.raises(ConfigurationError) as caught:
        require_region_in_survey(hillside_survey(), region)
    assert "region" in caught.value.where


def test_bases_below_the_ground_pass(write_ascii):
    survey = hillside_survey()
    path = write_ascii(lambda x, y: np.full(x.shape, 1.0), -20, -20, 1.0, 40, 40)
    for base in (DepthBase(depth=1), PlaneBase(points=[(0, 0, 3), (1, 0, 3), (0, 1, 3)]), RasterBase(path=path),
                 RasterBase(path=path, quantity="depth"), EarlierGroundBase(path=path)):  # fmt: skip
        require_region_in_survey(survey, BoxRegion(**SIDES, base=base))


def test_a_raster_elsewhere_is_refused_before_any_splats(write_ascii):
    path = write_ascii(lambda x, y: x, 900, 900, 1.0, 10, 10)
    with pytest.raises(ConfigurationError, match="no value over the region"):
        require_region_in_survey(hillside_survey(), BoxRegion(**SIDES, base=RasterBase(path=path)))


@pytest.mark.parametrize(
    "region",
    [
        lambda path: MeshRegion(path=path.with_suffix(".ply")),
        lambda path: PolygonRegion(path=path.with_suffix(".geojson"), base=DepthBase(depth=1)),
        lambda path: BoxRegion(**SIDES, base=RasterBase(path=path.with_suffix(".asc"))),
        lambda path: BoxRegion(**SIDES, base=EarlierGroundBase(path=path.with_suffix(".asc"))),
        lambda path: BoxRegion(**SIDES, base=MeshBase(path=path.with_suffix(".stl"))),
    ],
    ids=["mesh", "polygon", "raster", "earlier ground", "mesh base"],
)
@pytest.mark.parametrize("content", [None, b"\x00nonsense"], ids=["absent", "nonsense"])
def test_faults_in_files_are_told_at_once(tmp_path, region, content):
    made = region(tmp_path / "given")
    if content is not None:
        for suffix in (".ply", ".geojson", ".asc", ".stl"):
            (tmp_path / "given").with_suffix(suffix).write_bytes(content)
    with pytest.raises(InputError, match=r"can't be read|no triangle") as caught:
        read_region_files(made)
    assert str(tmp_path) in caught.value.where


def test_a_box_names_no_file():
    read_region_files(BoxRegion(**SIDES, z_min=0))


def volume(region):
    survey = hillside_survey()
    return volume_under(region, plan_of(region, survey.georeference), survey.sparse_points, survey.georeference)


def test_the_volume_under_the_sparse_points_is_about_that_of_the_mass():
    """A hillside some 5 m up over 8 m x 8 m."""
    seen = hillside_survey().sparse_points
    height = seen[(np.abs(seen[:, :2]) < 4).all(axis=1), 2].mean()
    assert volume(BoxRegion(**SIDES, z_min=0)) == pytest.approx(64 * height, rel=0.1)
    assert volume(BoxRegion(**SIDES, base=DepthBase(depth=2))) == pytest.approx(128)
    plane = PlaneBase(points=[(0, 0, 3), (1, 0, 3), (0, 1, 3)])
    assert volume(BoxRegion(**SIDES, base=plane)) == pytest.approx(64 * (height - 3), rel=0.2)


def test_cells_too_fine_for_memory_are_refused_before_any_splats(monkeypatch):
    monkeypatch.setattr(guards, "available_memory", lambda: 24_000_000_000)
    region, solver = BoxRegion(**SIDES, z_min=0), ReferenceSolver()
    with pytest.raises(ConfigurationError, match=r"at least 1\d\d m3 is .* particles in cells of 0\.01 m") as caught:
        require_room_for_mass(solver, hillside_survey(), region, sand_problem(spacing=0.01).simulation)
    assert caught.value.where == "simulation.grid_spacing"
    require_room_for_mass(solver, hillside_survey(), region, sand_problem(spacing=0.1).simulation)


@pytest.mark.parametrize("wall", [{"x_min": 0.0}, {"y_max": 1.0}, {"z_max": 2.0}])
def test_walls_in_the_mass_are_refused_before_any_splats(wall):
    region = BoxRegion(**SIDES, z_min=0)
    with pytest.raises(ConfigurationError, match=r"\d+% of the ground") as caught:
        require_mass_within_walls(hillside_survey(), region, Boundary(domain=Domain(**wall)))
    assert caught.value.where == "boundary.domain"
    require_mass_within_walls(hillside_survey(), region, Boundary(domain=Domain(x_min=-9, z_max=30)))
