"""Maps of a survey as pictures, north up, drawn with Pillow."""

import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.quality.appraisal import GOOD_ANGLE, GOOD_VIEWS, LEAST_VIEWS, Appraisal
from slideframe.quality.ground import Grid

Box = tuple[float, float, float, float]
Color = tuple[int, int, int]

SIDE = 620  # px of the map's longer side
MARGIN_LEFT, MARGIN_TOP, MARGIN_RIGHT, MARGIN_BOTTOM = 66, 40, 108, 46
INK, PALE, PAPER, NOTHING = (40, 44, 52), (214, 218, 224), (255, 255, 255), (240, 241, 243)
FIX_COLORS: dict[str | None, Color] = {
    "fixed": (38, 140, 72),
    "float": (232, 160, 20),
    "single": (214, 96, 28),
    "none": (190, 40, 40),
    None: (110, 116, 128),
}
LEFT_OUT_COLOR = (190, 40, 40)
# Red where a survey lacks, green where it suffices; stops at shares of the scale.
SCALE = np.array([[178, 34, 34], [236, 140, 50], [245, 220, 110], [120, 185, 95], [26, 120, 70]], np.float64)
HIGHLIGHTED_RESIDUAL = 40  # px that the longest residual is drawn with


def draw_maps(appraisal: Appraisal) -> dict[str, Image.Image]:
    """Return pictures by name: cameras, overlap, viewing angles, distances, residuals."""
    coverage = appraisal.coverage
    maps = {"cameras": draw_cameras(appraisal)}
    if coverage.mapped.any():
        views = np.where(coverage.mapped, coverage.views, np.nan).astype(np.float64)
        maps |= {
            "overlap": _draw_grid(appraisal, views, "photographs that see the ground", (0, 2 * GOOD_VIEWS), "{:g}"),
            "angles": _draw_grid(
                appraisal, coverage.angle, "largest angle between views, degrees", (0, 2 * GOOD_ANGLE), "{:.0f}"
            ),
            "distances": _draw_grid(
                appraisal, coverage.distance_ratio, "farthest over closest view", (1, 2.5), "{:.1f}"
            ),
        }
    if np.isfinite(appraisal.residuals).any():
        maps["residuals"] = draw_residuals(appraisal)
    return maps


def draw_cameras(appraisal: Appraisal) -> Image.Image:
    """Draw where the photographs were taken and which way they look, coloured by their satellite position."""
    survey = appraisal.survey
    chart = Chart(_extent(appraisal), "cameras, coloured by position fix")
    chart.raster(appraisal.coverage.west, appraisal.coverage.south, appraisal.coverage.cell, _shade(appraisal))
    for photograph, pose in zip(survey.photographs, survey.world_from_camera, strict=True):
        place, ahead = chart.at(*pose[:2, 3]), pose[:2, 2]
        tip = (place[0] + 18 * ahead[0], place[1] - 18 * ahead[1])
        chart.draw.line([place, tip], fill=INK, width=1)
        chart.dot(place, FIX_COLORS[photograph.fix], 5, ring=(200, 0, 200) if photograph.fault else INK)
    for item in survey.left_out:
        if item.stated_position:
            chart.cross(chart.at(*item.stated_position[:2]), LEFT_OUT_COLOR)
    for point in survey.ground_points:
        chart.triangle(chart.at(*point.position[:2]), (30, 90, 200) if point.role == "control" else PAPER)
    kinds: list[tuple[str, Color]] = [(fix, FIX_COLORS[fix]) for fix in appraisal.fix_counts()]
    chart.legend(kinds or [("unstated", FIX_COLORS[None])], crosses=bool(survey.left_out))
    return chart.image


def draw_residuals(appraisal: Appraisal) -> Image.Image:
    """Draw adjusted minus stated positions: horizontal parts as lines, vertical ones as colour."""
    residuals = appraisal.residuals
    known = np.isfinite(residuals).all(axis=1)
    normal = np.setdiff1d(np.flatnonzero(known), appraisal.outliers)
    longest = float(np.linalg.norm(residuals[normal, :2], axis=1).max(initial=1e-4))
    reach = max(float(np.abs(residuals[normal, 2]).max(initial=1e-3)), 1e-3)
    chart = Chart(_extent(appraisal), f"position residuals; the longest line is {100 * longest:.1f} cm")
    for index in np.flatnonzero(known):
        place = chart.at(*appraisal.survey.world_from_camera[index, :2, 3])
        offset = residuals[index] * HIGHLIGHTED_RESIDUAL / longest
        if index in appraisal.outliers:
            chart.cross(place, LEFT_OUT_COLOR)
            continue
        chart.draw.line([place, (place[0] + offset[0], place[1] - offset[1])], fill=INK, width=2)
        chart.dot(place, _blue_to_red(residuals[index, 2] / reach), 5, ring=INK)
    steps = [(f"{100 * share * reach:+.1f} cm up", _blue_to_red(share)) for share in (1.0, 0.5, 0.0, -0.5, -1.0)]
    chart.legend(steps, crosses=bool(len(appraisal.outliers)), cross_label="outlier")
    return chart.image


def colors_of(values: Grid, low: float, high: float) -> UInt8Array:
    """Return (…, 3) colours from red at `low` to green at `high`, and grey for NaN."""
    share = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0, 1)
    stops = np.linspace(0, 1, len(SCALE))
    colors = np.stack([np.interp(share, stops, SCALE[:, channel]) for channel in range(3)], axis=-1)
    colors[~np.isfinite(values)] = NOTHING
    return colors.round().astype(np.uint8)


class Chart:
    """A drawing over a box of ground, with a frame, ticks in metres and a title."""

    def __init__(self, box: Box, title: str) -> None:
        """Fit the box (west, south, east, north), m, into the picture."""
        self.west, self.south, east, north = box
        self.scale = SIDE / max(east - self.west, north - self.south)
        self.width, self.height = round((east - self.west) * self.scale), round((north - self.south) * self.scale)
        size = MARGIN_LEFT + self.width + MARGIN_RIGHT, MARGIN_TOP + self.height + MARGIN_BOTTOM
        self.image = Image.new("RGB", size, PAPER)
        self.draw = ImageDraw.Draw(self.image)
        self.font = ImageFont.load_default(13)
        self.draw.rectangle(self._frame(), fill=NOTHING, outline=INK)
        self.draw.text((MARGIN_LEFT, 12), title, fill=INK, font=ImageFont.load_default(16))
        self._ticks()

    def at(self, east: float, north: float) -> tuple[float, float]:
        """Return column and row of a place."""
        column = MARGIN_LEFT + (east - self.west) * self.scale
        return column, MARGIN_TOP + self.height - (north - self.south) * self.scale

    def raster(self, west: float, south: float, cell: float, colors: UInt8Array) -> None:
        """Draw coloured cells, rows from south to north, and the frame anew."""
        left, bottom = self.at(west, south)
        right, top = self.at(west + colors.shape[1] * cell, south + colors.shape[0] * cell)
        size = max(1, round(right - left)), max(1, round(bottom - top))
        picture = Image.fromarray(np.ascontiguousarray(colors[::-1])).resize(size, Image.Resampling.NEAREST)
        self.image.paste(picture, (round(left), round(top)))
        self.draw.rectangle(self._frame(), outline=INK)

    def dot(self, place: tuple[float, float], color: Color, radius: int, ring: Color) -> None:
        """Draw a filled circle."""
        self.draw.ellipse(_around(place, radius), fill=color, outline=ring, width=1 if ring == INK else 2)

    def cross(self, place: tuple[float, float], color: Color) -> None:
        """Draw a diagonal cross."""
        left, top, right, bottom = _around(place, 5)
        self.draw.line([(left, top), (right, bottom)], fill=color, width=3)
        self.draw.line([(left, bottom), (right, top)], fill=color, width=3)

    def triangle(self, place: tuple[float, float], color: Color) -> None:
        """Draw an upright triangle."""
        column, row = place
        self.draw.polygon([(column - 7, row + 5), (column + 7, row + 5), (column, row - 8)], fill=color, outline=INK)

    def legend(self, entries: list[tuple[str, Color]], *, crosses: bool, cross_label: str = "left out") -> None:
        """Explain dots, and crosses where there are some, right of the map."""
        left, top = MARGIN_LEFT + self.width + 16, MARGIN_TOP + 10
        for label, color in entries:
            self.dot((left, top), color, 5, ring=INK)
            self.draw.text((left + 10, top - 8), label, fill=INK, font=self.font)
            top += 22
        if crosses:
            self.cross((left, top), LEFT_OUT_COLOR)
            self.draw.text((left + 10, top - 8), cross_label, fill=INK, font=self.font)

    def bar(self, low: float, high: float, form: str) -> None:
        """Draw the scale of colours right of the map; its top stands for `high` and more."""
        left, top, length = MARGIN_LEFT + self.width + 16, MARGIN_TOP + 10, min(self.height - 20, 220)
        steps = np.linspace(high, low, length)
        strip = colors_of(np.repeat(steps[:, None], 16, axis=1), low, high)
        self.image.paste(Image.fromarray(strip), (left, top))
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            label = form.format(high - share * (high - low)) + ("+" if share == 0 else "")
            self.draw.text((left + 22, top + share * (length - 1) - 8), label, fill=INK, font=self.font)

    def _frame(self) -> Box:
        return MARGIN_LEFT, MARGIN_TOP, MARGIN_LEFT + self.width, MARGIN_TOP + self.height

    def _ticks(self) -> None:
        step = _round_step(SIDE / self.scale / 6)
        for east in _multiples(self.west, self.west + self.width / self.scale, step):
            column, _ = self.at(east, self.south)
            self.draw.line([(column, MARGIN_TOP + self.height), (column, MARGIN_TOP + self.height + 5)], fill=INK)
            self.draw.text((column, MARGIN_TOP + self.height + 7), f"{east:g}", fill=INK, font=self.font, anchor="ma")
        for north in _multiples(self.south, self.south + self.height / self.scale, step):
            _, row = self.at(self.west, north)
            self.draw.line([(MARGIN_LEFT - 5, row), (MARGIN_LEFT, row)], fill=INK)
            self.draw.text((MARGIN_LEFT - 8, row), f"{north:g}", fill=INK, font=self.font, anchor="rm")
        below = MARGIN_LEFT + self.width, MARGIN_TOP + self.height + 26
        self.draw.text(below, "east (right) and north (up) of the origin, m", fill=INK, font=self.font, anchor="ra")


def _draw_grid(appraisal: Appraisal, values: Grid, title: str, limits: tuple[float, float], form: str) -> Image.Image:
    coverage = appraisal.coverage
    chart = Chart(_extent(appraisal), title)
    chart.raster(coverage.west, coverage.south, coverage.cell, colors_of(values, *limits))
    for pose in appraisal.survey.world_from_camera:
        chart.dot(chart.at(*pose[:2, 3]), PAPER, 2, ring=INK)
    chart.bar(*limits, form)
    return chart.image


def _shade(appraisal: Appraisal) -> UInt8Array:
    """Return the ground in grey, lighter where fewer than three photographs see it."""
    coverage = appraisal.coverage
    shade = np.full((*coverage.height.shape, 3), NOTHING, np.uint8)
    shade[coverage.mapped] = PALE
    shade[coverage.mapped & (coverage.views < LEAST_VIEWS)] = (240, 214, 208)
    return shade


def _extent(appraisal: Appraisal) -> Box:
    """Return the box of cameras, ground points and mapped ground, with a rim."""
    survey, coverage = appraisal.survey, appraisal.coverage
    stated = [item.stated_position[:2] for item in survey.left_out if item.stated_position]
    places = [survey.world_from_camera[:, :2, 3], np.array([p.position[:2] for p in survey.ground_points])]
    if coverage.mapped.any():
        rows, columns = coverage.height.shape
        corner = np.array([coverage.west, coverage.south])
        places += [corner[None], corner[None] + coverage.cell * np.array([[columns, rows]])]
    near = np.concatenate([place.reshape(-1, 2) for place in places])
    low, high = near.min(axis=0), near.max(axis=0)
    reach = float(np.max(high - low, initial=1.0))
    within = [place for place in stated if np.all(np.abs(np.array(place) - (low + high) / 2) < 2 * reach)]
    low, high = np.min([low, *within], axis=0), np.max([high, *within], axis=0)
    rim = 0.05 * max(float((high - low).max()), 1.0)
    west, south = low - rim
    east, north = high + rim
    return float(west), float(south), float(east), float(north)


def _blue_to_red(share: float) -> Color:
    stops: Float64Array = np.array([[30, 80, 190], [245, 245, 245], [190, 30, 40]], np.float64)
    red, green, blue = (float(np.interp(share, [-1, 0, 1], stops[:, channel])) for channel in range(3))
    return round(red), round(green), round(blue)


def _around(place: tuple[float, float], radius: float) -> Box:
    return place[0] - radius, place[1] - radius, place[0] + radius, place[1] + radius


def _round_step(wanted: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not below `wanted`."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted * (1 - 1e-9))


def _multiples(low: float, high: float, step: float) -> list[float]:
    return [step * count for count in range(math.ceil(low / step), math.floor(high / step) + 1)]
