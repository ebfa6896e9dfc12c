"""Plans as pictures, north above, with a scale of colours."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import Float64Array
from slideframe.overlay import round_length
from slideframe.record.drawing import heat

# longer side of a map, px
MAP_SIZE = 480
MARGIN = 12
SCALE_WIDTH = 16
EMPTY = (24, 26, 30)
INK = (230, 230, 230)


def draw_thickness(thickness: Float64Array, most: float, cell: float) -> Image.Image:
    """Return the map of thickness (row, column), m, rows from the north; `most` is the end of the scale, m."""
    factor = max(1, MAP_SIZE // max(thickness.shape))
    colors = np.where((thickness > 0)[..., None], heat(np.clip(thickness / max(most, 1e-6), 0, 1)), EMPTY)
    plan = Image.fromarray(colors.astype(np.uint8)).resize(
        (thickness.shape[1] * factor, thickness.shape[0] * factor), Image.Resampling.NEAREST
    )
    picture = Image.new("RGB", (plan.width + 3 * MARGIN + SCALE_WIDTH + 60, plan.height + 2 * MARGIN + 28), EMPTY)
    picture.paste(plan, (MARGIN, MARGIN))
    _draw_scale(picture, plan.width + 2 * MARGIN, plan.height, most)
    ruler = ImageDraw.Draw(picture)
    length = round_length(plan.width / factor * cell / 3)
    top = plan.height + MARGIN + 8
    ruler.line([(MARGIN, top), (MARGIN + length / cell * factor, top)], fill=INK, width=3)
    ruler.text((MARGIN, top + 5), f"{length:g} m", fill=INK, font=ImageFont.load_default(12))
    return picture


def _draw_scale(picture: Image.Image, left: int, height: int, most: float) -> None:
    ramp = heat(np.linspace(1, 0, height))[:, None].repeat(SCALE_WIDTH, axis=1)
    picture.paste(Image.fromarray(ramp), (left, MARGIN))
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(12)
    for share in (0.0, 0.5, 1.0):
        place = left + SCALE_WIDTH + 5, MARGIN + (height - 14) * (1 - share)
        pen.text(place, f"{share * most:.1f} m", fill=INK, font=font)
