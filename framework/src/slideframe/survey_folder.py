"""What a survey leaves for people: its report, and the cameras in other programs' formats.

survey.html     the report, one self-contained file
cameras/        COLMAP model, as text and binary, nerfstudio's transforms.json, and the positions as CSV
"""

import json
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slideframe.bench import Keyed
from slideframe.errors import InputError, SlideframeError
from slideframe.georeferencing import Heights, stated_accuracy
from slideframe.problem import Region
from slideframe.products import Georeference, Survey
from slideframe.quality.appraisal import Appraisal, appraise
from slideframe.quality.ground import Bounds
from slideframe.release.plan import plan_of
from slideframe.store import storing

if TYPE_CHECKING:
    from PIL import Image

_log = logging.getLogger("slideframe")

REPORT, CAMERAS = "survey.html", "cameras"


def plan_bounds(region: Region | None, georeference: Georeference) -> Bounds | None:
    """Return the region's extent (x_min, x_max, y_min, y_max), m, or None where there is none that can be placed."""
    if region is None:
        return None
    try:
        (west, south), (east, north) = plan_of(region, georeference).bounds
    except SlideframeError as error:  # the run stops at it after the survey, whose report is wanted all the same
        _log.warning("the survey is judged as a whole, because the region can't be placed: %s", error.what)
        return None
    return float(west), float(east), float(south), float(north)


def appraise_survey(keyed: Keyed[Survey], region: Region | None) -> Appraisal:
    """Appraise a stored survey where the region lies, or all of it."""
    return appraise(keyed.value, plan_bounds(region, keyed.value.georeference))


def report_on(keyed: Keyed[Survey], region: Region | None) -> list[str]:
    """Return what an engineer in the field reads of a stored survey."""
    from slideframe.quality.page import report_lines

    return report_lines(appraise_survey(keyed, region), keyed.entry.manifest["figures"])


def survey_result(keyed: Keyed[Survey], appraisal: Appraisal, computed: bool) -> dict[str, Any]:
    """Return what `result.json` says of the survey: its stage's figures, then the appraisal's."""
    manifest = keyed.entry.manifest
    distribution, plugin, version = manifest["made_from"]["plugin"]
    return {
        "plugin": plugin,
        "distribution": f"{distribution} {version}",
        "computed_in_this_run": computed,
        **manifest["figures"],
        **appraisal.figures,
        "verdict": str(appraisal.verdict),
        "warnings": manifest["warnings"],
    }


def write_cameras(survey: Survey, folder: Path) -> list[str]:
    """Write `cameras/`; return what was left out, and why, where a format can't hold the survey."""
    from slideframe.formats.colmap import common_folder, write_colmap_text
    from slideframe.formats.colmap_binary import write_colmap_binary
    from slideframe.formats.posed_camera import PosedCamera
    from slideframe.formats.position_table import write_position_table
    from slideframe.formats.transforms_json import write_transforms_json

    left_out = []
    with storing(folder):
        write_colmap_binary(survey, folder / CAMERAS)
        try:
            write_colmap_text(survey, folder / CAMERAS)
        except InputError as error:
            for name in ("cameras.txt", "images.txt", "points3D.txt"):
                (folder / CAMERAS / name).unlink(missing_ok=True)
            _log.warning("%s/ holds no text model: %s", CAMERAS, error)
            left_out.append(f"{CAMERAS}/*.txt: {error.what}")
        common = common_folder(survey)
        views = [
            PosedCamera(photograph.path.relative_to(common).as_posix(), survey.camera_of(index), pose)
            for index, (photograph, pose) in enumerate(zip(survey.photographs, survey.world_from_camera, strict=True))
        ]
        write_transforms_json(views, folder / CAMERAS / "transforms.json")
        write_position_table(survey, folder / CAMERAS / "positions.csv")
    return left_out


def write_positions_in(survey: Survey, folder: Path, epsg: int, heights: Heights) -> str:
    """Write the cameras' positions in a coordinate system, and return a line that says where and how accurately.

    Raises:
        MissingDependency, InputError: the transformation lacks a grid, or the site lies outside the system's area.
    """
    from slideframe.formats.position_table import write_position_table

    path = folder / CAMERAS / f"positions_epsg{epsg}.csv"
    with storing(folder):
        write_position_table(survey, path, epsg, heights)
    accuracy = stated_accuracy(epsg, survey.georeference, heights)
    known = "not stated" if accuracy is None else f"{accuracy:g} m"
    return f"positions in EPSG:{epsg} (accuracy of the transformation from WGS84: {known}): {path}"


def write_report(
    folder: Path, name: str, keyed: Keyed[Survey], appraisal: Appraisal, maps: "dict[str, Image.Image]"
) -> None:
    """Write the report, whole or not at all."""
    from slideframe.quality.page import report_page

    manifest = keyed.entry.manifest
    page = report_page(name, appraisal, manifest["figures"], manifest["warnings"], maps)
    with storing(folder):
        partial = folder / f"{REPORT}.partial"
        partial.write_text(page, encoding="utf-8")
        partial.rename(folder / REPORT)


def write_result(path: Path, result: dict[str, Any]) -> None:
    """Write figures as JSON, whole or not at all."""
    with storing(path):
        partial = path.with_name(f"{path.name}.partial")
        partial.write_text(json.dumps(result, indent=1, allow_nan=False), encoding="utf-8")
        partial.rename(path)
