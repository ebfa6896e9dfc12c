"""Where the scan's surface stands off the reference ground, as a picture."""

import numpy as np
from PIL import Image

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.quality.drawing import NOTHING, Chart
from slideframe.quality.surface import SurfaceComparison

SHOWN_PERCENTILE = 98  # of the differences that the scale of colours spans
BELOW, SAME, ABOVE = (30, 80, 190), (245, 245, 245), (190, 30, 40)


def draw_difference(comparison: SurfaceComparison) -> Image.Image:
    """Return a map of surface minus reference, blue below it and red above, in cm."""
    x, y, difference = comparison.x, comparison.y, comparison.difference
    step = float(x[1] - x[0])
    gaps = np.abs(difference[np.isfinite(difference)])
    reach = max(float(np.percentile(gaps, SHOWN_PERCENTILE)) if gaps.size else 0.0, 1e-3)
    box = (float(x[0]) - step, float(y[0]) - step, float(x[-1]) + step, float(y[-1]) + step)
    chart = Chart(box, "surface minus reference ground")
    chart.raster(float(x[0]) - step / 2, float(y[0]) - step / 2, step, _colors(difference.T / reach))
    shares = np.array([1.0, 0.5, 0.0, -0.5, -1.0])
    labels = [f"{100 * share * reach:+.0f} cm" for share in shares]
    colors = [(int(red), int(green), int(blue)) for red, green, blue in _colors(shares)]
    chart.legend(list(zip(labels, colors, strict=True)), crosses=False)
    return chart.image


def _colors(share: Float64Array) -> UInt8Array:
    """Return colours (..., 3) of shares of the scale from -1 to 1; NaN is no ground."""
    stops = np.array([BELOW, SAME, ABOVE], float)
    colors = np.stack([np.interp(np.nan_to_num(share), [-1, 0, 1], stops[:, channel]) for channel in range(3)], -1)
    colors[~np.isfinite(share)] = NOTHING
    return colors.round().astype(np.uint8)
