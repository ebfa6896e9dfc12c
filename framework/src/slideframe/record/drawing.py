"""Numbers as rerun draws them: colours, quaternions, thinned lists."""

import io

import numpy as np
import numpy.typing as npt
import rerun as rr
from PIL import Image

from slideframe.arrays import Float32Array, UInt8Array
from slideframe.products import Filling

IndexArray = npt.NDArray[np.int64]

# the viewer draws no more than this fluently on a machine without a graphics card
DRAWN_SPLATS = 300_000
# zeroth real spherical harmonic, 1 / (2 sqrt(pi))
HARMONIC_0 = 0.28209479177387814
# 0 grey-blue, 0.5 yellow, 1 red
HEAT = np.array([[70, 90, 130], [240, 210, 80], [190, 30, 30]], float)


def real_part_last(rotations: Float32Array) -> Float32Array:
    """Return quaternions xyzw from wxyz."""
    return np.roll(rotations, -1, axis=1)


def rgba(harmonics: Float32Array, opacities: Float32Array) -> UInt8Array:
    """Return sRGB and opacity (splat, 4) from the harmonics' zeroth band."""
    color = 0.5 + HARMONIC_0 * harmonics[:, 0]
    return np.round(np.clip(np.column_stack([color, opacities]), 0, 1) * 255).astype(np.uint8)


def heat(share: npt.NDArray[np.floating]) -> UInt8Array:
    """Return the colour (..., 3) of each share: see HEAT."""
    channels = [np.interp(share, [0, 0.5, 1], HEAT[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def spacing_of(filling: Filling) -> float:
    """Return the edge of a usual particle's cube of soil, m."""
    return float(np.cbrt(np.median(filling.particle_volumes)))


def thinned(count: int, most: int) -> IndexArray:
    """Return at most `most` indices below `count`, evenly spread, first and last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def jpeg(pixels: UInt8Array) -> bytes:
    """Return the picture as a JPEG file."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=88)
    return buffer.getvalue()


def log_picture(stream: rr.RecordingStream, entity: str, picture: Image.Image) -> None:
    """Log a drawing, which doesn't change in time, as a PNG file."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    stream.log(entity, rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"), static=True)
