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
# Units at the end of a figure's name, as people write them.
UNITS = {"m": "m", "m2": "m²", "px": "px", "deg": "degrees", "mib": "MiB"}
STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#282c34;max-width:1100px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}
.verdict{padding:.8em 1em;border-left:8px solid;background:#f5f6f8;font-size:1.1em}
table{border-collapse:collapse;font-size:.9em}
td,th{padding:.2em .9em .2em 0;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}
table.summary{font-size:1em;margin:1em 0}table.summary td:first-child{font-weight:600;white-space:nowrap}
.warning{margin:.3em 0;padding:.3em .8em;border-left:4px solid #b8860b;background:#fdf6e3}
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
        _table((), summary(appraisal, figures), style="summary"),
        "".join(f"<p class=warning>⚠ {html.escape(warning)}</p>" for warning in warnings),
        *(_figure(key, picture) for key, picture in maps.items()),
        _ground_points(appraisal.survey),
        "<h2>Cameras</h2>",
        _cameras(appraisal.survey),
        "<h2>Figures</h2>",
        _table(
            ("figure", "value"),
            [(label(key), shown(value)) for key, value in {**figures, **appraisal.figures}.items()],
        ),
        "<h2>Photographs</h2>",
        _photographs(appraisal),
    ]
    return "\n".join(parts)


def report_lines(appraisal: Appraisal, figures: Mapping[str, Any]) -> list[str]:
    """Return what an engineer in the field reads, the verdict last."""
    lines = [f"{subject:<16}{text}" for subject, text in summary(appraisal, figures)]
    return [*lines, "", f"verdict: {appraisal.verdict}"]


def summary(appraisal: Appraisal, figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return subjects and what is to be said of each."""
    survey, own = appraisal.survey, appraisal.figures
    total = len(survey.photographs) + len(survey.left_out)
    fixes = ", ".join(f"{count} {fix}" for fix, count in appraisal.fix_counts().items()) or "unstated"
    return [
        ("photographs", f"{len(survey.photographs)} of {total} used; {own['faulty_photographs']} blurred or covered"),
        ("positions", f"RTK {fixes}; {own['position_outliers']} outliers{_residual_phrase(own)}"),
        *_adjustment(survey, figures),
        *_ground(own),
        *_surveyed(appraisal),
        ("origin", _origin(survey)),
    ]


def _adjustment(survey: Survey, figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    found = []
    if "reprojection_error_px" in figures:
        error = shown(figures["reprojection_error_px"])
        found.append(("adjustment", f"{error} px reprojection error, {len(survey.sparse_points)} points"))
    if "focal_length_rule" in figures:
        found.append(("focal length", figures["focal_length_rule"]))
    if "principal_point_rule" in figures:
        found.append(("principal point", figures["principal_point_rule"]))
    if "gimbal_yaw_bias_deg" in figures:
        turns = ", ".join(f"{turn:+.1f} ({name})" for name, turn in figures["gimbal_yaw_bias_deg"].items())
        off, least = figures["gimbal_error_deg"], figures["gimbal_error_without_mount_deg"]
        found.append(
            (
                "gimbal",
                f"yaw bias, degrees: {turns}; {off:.2f} degrees off without it (median), {least:.2f} without the"
                " camera's tilt in its mount",
            )
        )
    return found


def _ground(own: Mapping[str, Any]) -> list[tuple[str, str]]:
    if "median_views" not in own:
        return []
    return [
        (
            "ground",
            f"{own['mapped_ground_m2']:.0f} m² mapped, {1000 * own['ground_sampling_distance_m']:.1f} mm a pixel",
        ),
        (
            "overlap",
            f"{own['median_views']:.0f} photographs (median); {own['ground_in_3_views_share']:.0%} of the ground in 3"
            f" or more, {own['ground_in_5_views_share']:.0%} in 5 or more",
        ),
        (
            "views",
            f"{own['median_viewing_angle_deg']:.0f} degrees apart, farthest over closest"
            f" {own['median_distance_ratio']:.2f} (medians)",
        ),
        ("sensitivity", f"1 % of focal length moves heights by {own['height_sensitivity_m']:.2f} m (dH = H df/f)"),
    ]


def _surveyed(appraisal: Appraisal) -> list[tuple[str, str]]:
    found = []
    for role in ("control", "check"):
        count = len(appraisal.ground_residuals(role))
        if count:
            values = " / ".join(
                f"{appraisal.figures[f'{role}_residual_{axis}_m']:.3f}" for axis in ("east", "north", "up")
            )
            found.append((f"{role} points", f"{count}: {values} m rms east / north / up"))
    return found


def _origin(survey: Survey) -> str:
    place = survey.georeference
    return f"{place.latitude:.8f}, {place.longitude:.8f} degrees, {place.ellipsoidal_height:.3f} m (WGS84)"


def label(key: str) -> str:
    """Return a figure's name as people read it: words, and the unit behind a comma."""
    words, _, unit = key.rpartition("_")
    if words and unit in UNITS:
        return f"{words.replace('_', ' ')}, {UNITS[unit]}"
    return key.replace("_", " ")


def shown(value: Any) -> str:
    """Return a figure as people read it."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {shown(part)}" for name, part in value.items())
    if isinstance(value, float):
        return f"{value:.0f}" if value.is_integer() or abs(value) >= 1000 else f"{value:.4g}"
    return str(value)


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


def _cameras(survey: Survey) -> str:
    head = ("camera", "photographs", "size, px", "focal length, px", "principal point, px", "k1, k2, p1, p2, k3")
    rows = []
    for number, camera in enumerate(survey.cameras):
        count = sum(photograph.camera == number for photograph in survey.photographs)
        distortion = ", ".join(f"{term:.6f}" for term in camera.distortion)
        focal, principal = (camera.focal_x, camera.focal_y), (camera.principal_x, camera.principal_y)
        pairs = [f"{first:.2f}, {second:.2f}" for first, second in (focal, principal)]
        rows.append((str(number + 1), str(count), f"{camera.width} x {camera.height}", *pairs, distortion))
    return _table(head, rows)


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
        remarks = (
            photograph.fault,
            "position outlier" if index in outliers else None,
            "pose from metadata alone" if photograph.pose == "metadata" else None,
        )
        remark = ", ".join(filter(None, remarks))
        rows.append((photograph.name, photograph.fix or "", *shift, sharpness, remark))
    rows += [(item.name, item.fix or "", "", "", "", "", f"left out: {item.reason}") for item in survey.left_out]
    return _table(("file", "fix", "east, cm", "north, cm", "up, cm", "sharpness", "remark"), rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], style: str = "figures") -> str:
    header = "<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table class={style}>{header}{body}</table>"
