"""What a survey leaves for people: its report, and the cameras in other programs' formats.

survey.html     the report, one self-contained file
cameras/        COLMAP text model
"""

import json
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slideframe.bench import Keyed
from slideframe.errors import InputError
from slideframe.problem import BoxRegion, Region
from slideframe.products import Survey
from slideframe.quality.appraisal import Appraisal, appraise
from slideframe.quality.ground import Bounds
from slideframe.store import storing

if TYPE_CHECKING:
    from PIL import Image

_log = logging.getLogger("slideframe")

REPORT, CAMERAS = "survey.html", "cameras"


def plan_bounds(region: Region | None) -> Bounds | None:
    """Return the region's plan (x_min, x_max, y_min, y_max), m, or None where only the survey can tell."""
    if isinstance(region, BoxRegion):
        return region.x_min, region.x_max, region.y_min, region.y_max
    return None


def appraise_survey(keyed: Keyed[Survey], region: Region | None) -> Appraisal:
    """Appraise a stored survey where the region lies, or all of it."""
    return appraise(keyed.value, plan_bounds(region))


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
    """Write `cameras/`; return why it was left out, where its format can't hold the survey."""
    from slideframe.formats.colmap import write_colmap_text

    try:
        with storing(folder):
            write_colmap_text(survey, folder / CAMERAS)
    except InputError as error:
        _log.warning("%s/ is left out: %s", CAMERAS, error)
        return [f"{CAMERAS}/: {error.what}"]
    return []


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
