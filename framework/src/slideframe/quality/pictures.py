"""Photographs that show nothing: blurred, or with the lens covered."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt
from PIL import Image

Fault = Literal["blurred", "covered"]
Gray = npt.NDArray[np.float32]

MEASURED_SIZE = 1600  # px, the longer side: blur that a reduction to this size hides costs no detail worth having
# Detail fades from one halving of the picture to the next the less, the sharper it is. Measured at 1600 px: 0.65 and
# more on 64 good photographs (Mirafiori, the embedded demo); 0.39 on a real blurred one; 0.36 to 0.39 with Gaussian
# blur of 2 px; 0.43 to 0.54 with 5 to 20 px of motion. tests/framework/quality/test_pictures.py holds it to that.
LEAST_SHARPNESS = 0.55
# Standard deviation of brightness (0 to 255): 0.8 and 1.6 under a lens cap, 35 and more on good photographs.
LEAST_CONTRAST = 5.0


@dataclass(frozen=True)
class PictureQuality:
    """What a photograph's pixels say of it.

    Attributes:
        sharpness: least ratio of fine to coarse detail over directions and scales; 0.65 to 1 where sharp.
        contrast: standard deviation of brightness, 0 to 255.
    """

    sharpness: float
    contrast: float

    @property
    def fault(self) -> Fault | None:
        """Why the photograph is of no use, or None."""
        if self.contrast < LEAST_CONTRAST:
            return "covered"
        return "blurred" if self.sharpness < LEAST_SHARPNESS else None


def inspect_picture(picture: Image.Image) -> PictureQuality:
    """Measure a photograph of any size and mode.

    Detail is the mean size of second differences along four directions, so that motion, which blurs one of
    them alone, is found too. Noise lives in the finest scale, which is therefore left out.
    """
    gray = picture.convert("L")
    gray.thumbnail((MEASURED_SIZE, MEASURED_SIZE), Image.Resampling.BOX)
    scales = [np.asarray(gray, np.float32)]
    while len(scales) < 4 and min(scales[-1].shape) >= 8:
        scales.append(_halved(scales[-1]))
    details = [_detail(scale) for scale in scales[1:]]
    ratios = [fine / np.maximum(coarse, 1e-6) for fine, coarse in pairwise(details)]
    sharpness = float(np.min(ratios)) if ratios else 1.0
    return PictureQuality(sharpness=sharpness, contrast=float(scales[0].std()))


def _halved(gray: Gray) -> Gray:
    rows, columns = gray.shape[0] // 2, gray.shape[1] // 2
    halved: Gray = gray[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean(axis=(1, 3))
    return halved


def _detail(gray: Gray) -> Gray:
    """Return the mean absolute second difference along rows, columns and both diagonals."""
    twice = 2 * gray[1:-1, 1:-1]
    neighbours = (
        gray[1:-1, :-2] + gray[1:-1, 2:],
        gray[:-2, 1:-1] + gray[2:, 1:-1],
        gray[:-2, :-2] + gray[2:, 2:],
        gray[:-2, 2:] + gray[2:, :-2],
    )
    return np.array([np.abs(twice - pair).mean() for pair in neighbours], np.float32)
