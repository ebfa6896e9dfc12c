"""Time, scale bar and legend on a picture."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.products import Camera

# shares of the picture's height
MARGIN, TEXT = 0.025, 0.032
# longest scale bar, share of the picture's width
LONGEST_BAR = 0.25
INK, SHADE = (255, 255, 255), (0, 0, 0)


@dataclass(frozen=True)
class Overlay:
    """What is written on every picture of a film.

    Attributes:
        legend: lines at the lower left.
        target: (3,), the place whose distance the scale bar holds at, m.
    """

    legend: tuple[str, ...]
    target: Float64Array

    def on(self, pixels: UInt8Array, time: float, camera: Camera, world_from_camera: Float64Array) -> UInt8Array:
        """Return the picture with the time in s above, and below the legend and a scale bar."""
        picture = Image.fromarray(pixels)
        pen = ImageDraw.Draw(picture)
        size = max(10, round(TEXT * picture.height))
        margin, font = round(MARGIN * picture.height), ImageFont.load_default(size)
        _write(pen, (margin, margin), f"t = {time:.2f} s", font)
        for line, text in enumerate(reversed(self.legend)):
            _write(pen, (margin, picture.height - margin - (line + 1) * round(1.3 * size)), text, font)
        self._draw_bar(pen, picture.size, margin, font, camera, world_from_camera)
        return np.asarray(picture)

    def _draw_bar(
        self,
        pen: ImageDraw.ImageDraw,
        size: tuple[int, int],
        margin: int,
        font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
        camera: Camera,
        world_from_camera: Float64Array,
    ) -> None:
        depth = float((self.target - world_from_camera[:, 3]) @ world_from_camera[:, 2])
        if depth <= 0:  # the target is behind the camera: there is nothing that the bar would measure
            return
        length = round_length(LONGEST_BAR * size[0] * depth / camera.focal_x)
        pixels = length * camera.focal_x / depth
        right, low = size[0] - margin, size[1] - margin
        thick = max(2, margin // 4)
        pen.rectangle([right - pixels - 1, low - thick - 1, right + 1, low + 1], fill=SHADE)
        pen.rectangle([right - pixels, low - thick, right, low], fill=INK)
        text = f"{length:g} m"
        _, top, width, bottom = pen.textbbox((0, 0), text, font=font)
        _write(pen, (round(right - pixels / 2 - width / 2), round(low - thick - 4 - (bottom - top) - top)), text, font)


def round_length(longest: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that isn't longer than `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(max(step * power for step in (1, 2, 5) if step * power <= longest * (1 + 1e-9)))


def _write(
    pen: ImageDraw.ImageDraw,
    place: tuple[int, int],
    text: str,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
) -> None:
    pen.text(place, text, fill=INK, font=font, stroke_width=1, stroke_fill=SHADE)
