"""A vertical section through the mass, as a picture."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import Float64Array, UInt8Array

WIDTH, HEIGHT, MARGIN = 960, 480, 46
PAPER, INK, FAINT = (24, 26, 30), (230, 230, 230), (90, 94, 100)
MASS, TERRAIN, PARTICLE = (176, 122, 78), (84, 78, 74), (226, 196, 150)
NAMES = ("observed", "interpolated", "extrapolated")


@dataclass(frozen=True)
class Profile:
    """What a section shows.

    Attributes:
        distance: along the section (step,), m.
        ground: height of the scanned ground (step,), m; NaN where there is none.
        terrain: height once the mass is taken out (step,), m; NaN where there is none.
        support: class of the ground (step,): 0 observed, 1 interpolated, 2 extrapolated.
        particles: distance and height of the particles near the section (particle, 2), m.
        spacing: of particles, m.
        bearing: compass direction from left to right, degrees.
    """

    distance: Float64Array
    ground: Float64Array
    terrain: Float64Array
    support: UInt8Array
    particles: Float64Array
    spacing: float
    bearing: float


def draw_section(profile: Profile, colors: UInt8Array) -> Image.Image:
    """Return the section at one scale along and up, the ground's line in the `colors` (3, 3) of its support."""
    picture = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(13)
    known = np.isfinite(profile.ground) & np.isfinite(profile.terrain)
    if not known.any():
        return picture
    low = float(np.nanmin(profile.terrain))
    high = float(np.nanmax(profile.ground))
    scale = min((WIDTH - 2 * MARGIN) / profile.distance[-1], (HEIGHT - 3 * MARGIN) / max(high - low, 1e-6))
    bottom = HEIGHT - 1.6 * MARGIN

    def place(distance: npt.NDArray[np.floating], height: npt.NDArray[np.floating]) -> list[tuple[float, float]]:
        return list(zip(MARGIN + distance * scale, bottom - (height - low) * scale, strict=True))

    for first, last in _runs(known):
        part = slice(first, last)
        base = place(profile.distance[part], profile.terrain[part])
        top = place(profile.distance[part], profile.ground[part])
        pen.polygon([*base, (base[-1][0], bottom + 8), (base[0][0], bottom + 8)], fill=TERRAIN)
        for (x, under), (_, over) in zip(base, top, strict=True):
            if under - over > 1:
                pen.line([(x, under), (x, over)], fill=MASS, width=int(np.ceil(WIDTH / len(profile.distance))) + 1)
    radius = float(np.clip(0.2 * profile.spacing * scale, 0.6, 4))
    for x, y in place(*profile.particles.T):
        pen.ellipse([x - radius, y - radius, x + radius, y + radius], fill=PARTICLE)
    points = place(profile.distance, profile.ground)
    for step in np.flatnonzero(known[1:] & known[:-1]):
        pen.line([points[step], points[step + 1]], fill=tuple(colors[profile.support[step]].tolist()), width=3)
    _draw_scale(pen, font, profile, scale, low, high)
    for number, name in enumerate(NAMES):
        pen.text((MARGIN + 120 * number, 10), name, fill=tuple(colors[number].tolist()), font=font)
    return picture


def _draw_scale(
    pen: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    profile: Profile,
    scale: float,
    low: float,
    high: float,
) -> None:
    """Write heights at the left, distances below, and where the section leads."""
    bottom = HEIGHT - 1.6 * MARGIN
    step = _round_step((high - low) / 4)
    for height in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step:
        level = bottom - (height - low) * scale
        pen.line([(MARGIN - 5, level), (MARGIN, level)], fill=FAINT)
        pen.text((4, level - 7), f"{height:g}", fill=INK, font=font)
    step = _round_step(profile.distance[-1] / 6)
    for distance in np.arange(0, profile.distance[-1], step):
        x = MARGIN + distance * scale
        pen.line([(x, bottom + 8), (x, bottom + 13)], fill=FAINT)
        pen.text((x - 6, bottom + 15), f"{distance:g}", fill=INK, font=font)
    pen.text(
        (MARGIN, HEIGHT - 22), f"m along the section, towards {profile.bearing:.0f}°; heights in m", fill=INK, font=font
    )


def _round_step(length: float) -> float:
    """Return 1, 2 or 5 times a power of ten near a length."""
    power = 10.0 ** np.floor(np.log10(max(length, 1e-6)))
    return float(power * min((1, 2, 5, 10), key=lambda factor: abs(factor - length / power)))


def _runs(known: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last + 1 of every stretch of true values of two or more."""
    edges = np.flatnonzero(np.diff(np.r_[0, known.astype(np.int8), 0]))
    return [(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True) if last - first > 1]
