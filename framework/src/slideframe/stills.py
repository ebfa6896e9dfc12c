"""Single pictures that tell a film's story: the contact sheet, and before beside after."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import UInt8Array

# Of a sheet, px.
SHEET_WIDTH, GAP, LABEL = 1600, 6, 22
PAPER, INK = (20, 20, 22), (235, 235, 235)

# The pixels and the time, s, of a film's picture by its number.
FilmPicture = Callable[[int], tuple[UInt8Array, float]]


def contact_sheet(picture: FilmPicture, count: int, shown: int) -> Image.Image:
    """Return at most `shown` of a film's `count` pictures, evenly spread, under one another with their times."""
    numbers = np.unique(np.linspace(0, count - 1, min(count, shown)).round().astype(int))
    columns = math.ceil(math.sqrt(len(numbers)))
    rows = math.ceil(len(numbers) / columns)
    width = (SHEET_WIDTH - GAP) // columns - GAP
    pixels, _ = picture(0)
    height = max(1, round(width * pixels.shape[0] / pixels.shape[1]))
    sheet = Image.new("RGB", (columns * (width + GAP) + GAP, rows * (height + LABEL + GAP) + GAP), PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(LABEL - 8)
    for place, number in enumerate(numbers):
        pixels, time = picture(int(number))
        left, top = GAP + place % columns * (width + GAP), GAP + place // columns * (height + LABEL + GAP)
        sheet.paste(Image.fromarray(pixels).resize((width, height), Image.Resampling.LANCZOS), (left, top))
        pen.text((left + 2, top + height + 2), f"{time:.2f} s", fill=INK, font=font)
    return sheet


def side_by_side(pictures: Sequence[tuple[UInt8Array, str]]) -> Image.Image:
    """Return pictures of one size in a row, each with its label above."""
    height, width = pictures[0][0].shape[:2]
    sheet = Image.new("RGB", (len(pictures) * (width + GAP) + GAP, height + LABEL + 2 * GAP), PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(LABEL - 6)
    for place, (pixels, label) in enumerate(pictures):
        left = GAP + place * (width + GAP)
        pen.text((left + 2, 3), label, fill=INK, font=font)
        sheet.paste(Image.fromarray(pixels), (left, LABEL + GAP))
    return sheet
