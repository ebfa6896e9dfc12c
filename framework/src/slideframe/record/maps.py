"""Plans as pictures, north above, with a scale of colours."""

import io
from dataclasses import dataclass

import numpy as np
import rerun as rr
from PIL import Image, ImageDraw, ImageFont

from slideframe.arrays import Float32Array, Float64Array
from slideframe.overlay import round_length
from slideframe.plan import PlanGrid
from slideframe.products import Filling, ParticleFrame
from slideframe.record.drawing import heat, spacing_of

# longer side of a map, px
MAP_SIZE = 480
MARGIN = 12
SCALE_WIDTH = 16
EMPTY = (24, 26, 30)
INK = (230, 230, 230)
# columns of the map, in edges of a particle's cube: fewer particles make the thickness jump
MAP_CELL = 2.0


@dataclass(frozen=True)
class ThicknessMap:
    """The soil's thickness in plan: the grid, the particles' volumes, m3, and the end of the scale, m."""

    grid: PlanGrid
    volumes: Float32Array
    most: float

    @classmethod
    def over(cls, filling: Filling, last: ParticleFrame) -> "ThicknessMap":
        """Reach over the soil at t = 0 and in the last frame; the scale ends at the thickest soil at t = 0."""
        start, spacing = filling.particle_positions, spacing_of(filling)
        # whole particles of a lattice fall into each column
        corner = start[:, :2].min(axis=0).astype(np.float64) - spacing / 2
        grid = PlanGrid.covering((start, last.positions), MAP_CELL * spacing, corner)
        return cls(
            grid, filling.particle_volumes, float(grid.thickness(start, filling.particle_volumes).max(initial=0))
        )

    def log(self, stream: rr.RecordingStream, frame: ParticleFrame) -> None:
        """Log the map of a frame."""
        file = io.BytesIO()
        draw_thickness(self.grid.thickness(frame.positions, self.volumes), self.most, self.grid.cell).save(file, "PNG")
        stream.log("map/thickness", rr.EncodedImage(contents=file.getvalue(), media_type="image/png"))


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
