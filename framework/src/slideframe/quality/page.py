"""The survey's report as one self-contained HTML file, and as lines for a terminal."""

import base64
import html
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from slideframe.products import Survey
from slideframe.quality.appraisal import Appraisal

CAPTIONS = {
    "cameras": "Dots are cameras, strokes the way they look; a violet ring marks a blurred or covered photograph, a "
    "triangle a surveyed point. Reddish ground is in fewer than three photographs.",
    "overlap": "From a count of five on, a point's place is well checked.",
    "angles": "The paper's second principle: several viewing angles. Ground that hides other ground is neglected.",
    "distances": "The paper's first principle: several distances.",
    "residuals": "Adjusted minus stated positions: what the photographs say of the satellite positions.",
}
COLORS = {"good": "#1a7846", "usable with reservations": "#b8860b", "fly again": "#b22222"}
STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#282c34;max-width:1100px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}
.verdict{padding:.8em 1em;border-left:8px solid;background:#f5f6f8;font-size:1.1em}
table{border-collapse:collapse;font-size:.9em}
td,th{padding:.2em .9em .2em 0;text-align:left;border-bottom:1px solid #ddd}
figure{display:inline-block;margin:0 1em 1em 0;vertical-align:top;max-width:520px}
figure img{max-width:100%;border:1px solid #ddd}figcaption{font-size:.85em;color:#555}
"""


def report_page(
    name: str,
    appraisal: Appraisal,
    figures: Mapping[str, Any],
    warnings: Sequence[str],
    maps: Mapping[str, Image.Image],
) -> str:
    """Return the HTML; `figures` are the pose source's own, `maps` those of `drawing.draw_maps`."""
    verdict = appraisal.verdict
    reasons = "".join(f"<li>{html.escape(reason)}</li>" for reason in verdict.reasons)
    parts = [
        f"<!doctype html><meta charset=utf-8><title>{html.escape(name)}</title><style>{STYLE}</style>",
        f"<h1>Survey {html.escape(name)}</h1>",
        f'<div class=verdict style="border-color:{COLORS[verdict.level]}">',
        f"<b>{verdict.level}</b><ul>{reasons}</ul></div>",
        "".join(f"<p>⚠ {html.escape(warning)}</p>" for warning in warnings),
        *(_figure(key, picture) for key, picture in maps.items()),
        "<h2>Figures</h2>",
        _table(("figure", "value"), [(key, shown(value)) for key, value in {**figures, **appraisal.figures}.items()]),
        _ground_points(appraisal.survey),
        "<h2>Photographs</h2>",
        _photographs(appraisal),
    ]
    return "\n".join(parts)


def report_lines(appraisal: Appraisal, figures: Mapping[str, Any]) -> list[str]:
    """Return what an engineer in the field reads, the verdict last."""
    survey, own = appraisal.survey, appraisal.figures
    total = len(survey.photographs) + len(survey.left_out)
    fixes = ", ".join(f"{count} {fix}" for fix, count in appraisal.fix_counts().items()) or "unstated"
    lines = [
        f"photographs     {len(survey.photographs)} of {total} used; {own['faulty_photographs']} blurred or covered",
        f"positions       RTK {fixes}; {own['position_outliers']} outliers{_residual_phrase(own)}",
    ]
    if "reprojection_error_px" in figures:
        lines.append(
            f"adjustment      {shown(figures['reprojection_error_px'])} px reprojection error, "
            f"{len(survey.sparse_points)} points"
        )
    if "focal_length_rule" in figures:
        lines.append(f"focal length    {figures['focal_length_rule']}")
    if "median_views" in own:
        lines += [
            f"ground          {own['mapped_ground_m2']:.0f} m2 mapped,"
            f" {1000 * own['ground_sampling_distance_m']:.1f} mm a pixel",
            f"overlap         {own['median_views']:.0f} photographs (median);"
            f" {own['ground_in_3_views_share']:.0%} of the ground in 3 or more,"
            f" {own['ground_in_5_views_share']:.0%} in 5 or more",
            f"views           {own['median_viewing_angle_deg']:.0f} degrees apart, farthest over closest"
            f" {own['median_distance_ratio']:.2f} (medians)",
            f"sensitivity     1 % of focal length moves heights by {own['height_sensitivity_m']:.2f} m (dH = H df/f)",
        ]
    for role in ("control", "check"):
        count = len(appraisal.ground_residuals(role))
        if count:
            values = " / ".join(f"{own[f'{role}_residual_{axis}_m']:.3f}" for axis in ("east", "north", "up"))
            lines.append(f"{role + ' points':<16}{count}: {values} m rms east / north / up")
    return [*lines, "", f"verdict: {appraisal.verdict}"]


def shown(value: Any) -> str:
    """Return a figure as people read it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _residual_phrase(own: Mapping[str, Any]) -> str:
    if "position_residual_east_m" not in own:
        return ""
    values = " / ".join(f"{100 * own[f'position_residual_{axis}_m']:.1f}" for axis in ("east", "north", "up"))
    return f"; residuals {values} cm rms east / north / up"


def _figure(key: str, picture: Image.Image) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", optimize=True)
    data = base64.b64encode(buffer.getvalue()).decode()
    caption = html.escape(CAPTIONS.get(key, ""))
    return f'<figure><img alt="{key}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'


def _ground_points(survey: Survey) -> str:
    if not survey.ground_points:
        return ""
    rows = []
    for point in survey.ground_points:
        residual = [f"{value:+.3f}" for value in point.residual] if point.residual else ["", "", ""]
        error = "" if point.reprojection_error is None else f"{point.reprojection_error:.2f}"
        rows.append((point.name, point.role, str(point.sightings), *residual, error))
    head = ("point", "role", "photographs", "east, m", "north, m", "up, m", "px")
    return "<h2>Surveyed points, photographs minus survey</h2>" + _table(head, rows)


def _photographs(appraisal: Appraisal) -> str:
    rows = []
    survey, outliers = appraisal.survey, set(appraisal.outliers.tolist())
    for index, photograph in enumerate(survey.photographs):
        residual = appraisal.residuals[index]
        shift = [f"{100 * value:+.1f}" if np.isfinite(value) else "" for value in residual]
        sharpness = "" if photograph.sharpness is None else f"{photograph.sharpness:.2f}"
        remark = " ".join(filter(None, (photograph.fault, "position outlier" if index in outliers else None)))
        rows.append((photograph.name, photograph.fix or "", *shift, sharpness, remark))
    rows += [(item.name, item.fix or "", "", "", "", "", f"left out: {item.reason}") for item in survey.left_out]
    return _table(("file", "fix", "east, cm", "north, cm", "up, cm", "sharpness", "remark"), rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    header = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{header}</tr>{body}</table>"
