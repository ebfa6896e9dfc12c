"""Regions judged before there is a surface."""

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, InputError
from slideframe.pipeline import require_region_in_survey
from slideframe.problem import (
    BoxRegion,
    DepthBase,
    EarlierGroundBase,
    MeshBase,
    MeshRegion,
    PlaneBase,
    PolygonRegion,
    RasterBase,
)
from slideframe.release.coverage import read_region_files
from slideframe.testing.ground_scenes import hillside_survey

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
