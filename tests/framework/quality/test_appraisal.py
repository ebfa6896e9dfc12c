import re
from pathlib import Path

import numpy as np
import pytest

from slideframe.products import GroundPoint, LeftOut
from slideframe.quality.appraisal import appraise
from slideframe.quality.drawing import draw_maps
from slideframe.quality.page import label, report_lines, report_page, shown

# Everywhere five views and more, 45 degrees and more apart, from 40 and 80 m.
GRID = [(x, y, z) for z in (40, 80) for x in (-20, 0, 20) for y in (-20, 0, 20)]


def good(field, **fields):
    count = len(GRID)
    return field(GRID, **{"fix": ["fixed"] * count, "stated_position": GRID, **fields})


def test_a_good_survey_is_good(field) -> None:
    appraisal = appraise(good(field))
    assert appraisal.verdict.level == "good", appraisal.verdict
    assert appraisal.verdict.reasons == ()
    assert appraisal.figures["position_residual_up_m"] == 0


def test_too_few_views_mean_to_fly_again(field) -> None:
    verdict = appraise(field(GRID[:2], fix=["fixed"] * 2)).verdict
    assert verdict.level == "fly again"
    assert "fewer than 3 photographs" in str(verdict)


def test_one_height_straight_down_is_stated(field) -> None:
    places = [(x, y, 40.0) for x in np.linspace(-4, 4, 5) for y in np.linspace(-4, 4, 5)]
    verdict = appraise(field(places, fix=["fixed"] * 25), bounds=(-10, 10, -10, 10)).verdict
    assert verdict.level == "usable with reservations"
    assert "oblique" in str(verdict)
    assert "close views" in str(verdict)


@pytest.mark.parametrize(("fixed", "level"), [(17, "usable with reservations"), (6, "fly again"), (18, "good")])
def test_lost_rtk_counts(field, fixed: int, level: str) -> None:
    verdict = appraise(good(field, fix=["fixed"] * fixed + ["float"] * (18 - fixed))).verdict
    assert verdict.level == level
    assert (level == "good") == ("RTK" not in str(verdict))


def test_control_points_make_up_for_lost_rtk(field) -> None:
    points = tuple(
        GroundPoint(name=f"{i}", role="control", position=(i, 0, 0), residual=(0.01, 0, 0.02), sightings=4)
        for i in range(3)
    )
    appraisal = appraise(good(field, fix=["none"] * 18, ground_points=points))
    assert appraisal.verdict.level == "usable with reservations"
    assert appraisal.figures["control_residual_up_m"] == pytest.approx(0.02)
    assert "check_residual_up_m" not in appraisal.figures


def test_a_false_position_is_an_outlier_and_spoils_no_figure(field) -> None:
    stated = [list(place) for place in GRID]
    stated[4][0] += 3.0
    stated[5][2] += 0.05  # less than 10 cm matters to nobody
    appraisal = appraise(good(field, stated_position=[tuple(place) for place in stated]))
    assert appraisal.outliers.tolist() == [4]
    assert appraisal.figures["position_residual_east_m"] < 1e-9
    assert "004.jpg" in str(appraisal.verdict)


def test_faulty_and_lost_photographs_are_named(field) -> None:
    left = tuple(LeftOut(path=Path(f"x{i}.jpg"), reason="not registered", fault="covered") for i in range(3))
    verdict = appraise(good(field, fault=["blurred"] + [None] * 17, left_out=left)).verdict
    assert verdict.level == "fly again"
    assert "3 of 21 photographs are left out" in str(verdict)
    assert "4 blurred or covered (000.jpg" in str(verdict)


def test_height_sensitivity_is_one_percent_of_the_height(field) -> None:
    """DH = H df / f: from 40 m, 1 % of the focal length is 0.4 m."""
    places = [(x, y, 40.0) for x in (-9, 0, 9) for y in (-9, 0, 9)]
    assert appraise(field(places)).figures["height_sensitivity_m"] == pytest.approx(0.4)


def test_maps_show_their_scale(field) -> None:
    """The ground under many views is green, under few red; every map has pixels of its own."""
    maps = draw_maps(appraise(good(field)))
    assert set(maps) == {"cameras", "overlap", "angles", "distances", "residuals"}
    few = draw_maps(appraise(field(GRID[:1])))["overlap"]
    many = maps["overlap"]

    def mean_color(picture) -> np.ndarray:
        pixels = np.asarray(picture)
        row, column = pixels.shape[0] // 2, pixels.shape[1] // 2 - 30
        return pixels[row - 60 : row + 60, column - 60 : column + 60].reshape(-1, 3).mean(axis=0)

    assert mean_color(many)[1] > mean_color(many)[0]
    assert mean_color(few)[0] > mean_color(few)[1]


def test_figures_are_written_as_people_read_them() -> None:
    assert label("reprojection_error_px") == "reprojection error, px"
    assert label("mapped_ground_m2") == "mapped ground, m²"
    assert label("flights") == "flights"
    assert shown({"flight 1": 1.96942, "flight 2": -0.5}) == "flight 1: 1.969, flight 2: -0.5"
    assert [shown(value) for value in (32.0, 12786.1, 0.04712, 3)] == ["32", "12786", "0.04712", "3"]


def test_the_page_is_self_contained_and_escapes_names(field) -> None:
    left = (LeftOut(path=Path("<b>.jpg"), reason="not <registered>"),)
    appraisal = appraise(good(field, left_out=left))
    page = report_page("a & b", appraisal, {"reprojection_error_px": 0.5}, ["mind <this>"], draw_maps(appraisal))
    assert not re.search(r'(?:src|href)="(?!data:)', page), "nothing is fetched"
    assert page.count("data:image/png;base64,") == 5
    assert "<b>.jpg" not in page
    assert "&lt;b&gt;.jpg" in page
    assert "mind &lt;this&gt;" in page
    assert "usable with reservations" in page


def test_the_lines_end_with_the_verdict(field) -> None:
    lines = report_lines(appraise(good(field)), {"reprojection_error_px": 0.5})
    assert lines[-1] == "verdict: good"
    assert any("0.5 px reprojection error" in line for line in lines)
