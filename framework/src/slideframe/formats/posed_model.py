"""Another program's result: views and sparse points, in the frame that its file has."""

from dataclasses import dataclass, field

import numpy as np

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.formats.posed_camera import PosedCamera
from slideframe.products import Georeference


@dataclass(frozen=True, eq=False)
class PosedModel:
    """Views and points in one frame, right-handed, of unit scale where `frame` says metres.

    Attributes:
        views: where each picture was taken.
        points: (point, 3).
        colors: (point, 3) sRGB.
        errors: (point,) px, mean reprojection error; NaN where the file doesn't keep it.
        georeference: origin of the east-north-up frame that the model is in, where the file states one.
        remarks: what of the file could only be taken over in part, as sentences.
    """

    views: tuple[PosedCamera, ...]
    points: Float64Array = field(default_factory=lambda: np.empty((0, 3)))
    colors: UInt8Array = field(default_factory=lambda: np.empty((0, 3), np.uint8))
    errors: Float64Array = field(default_factory=lambda: np.empty(0))
    georeference: Georeference | None = None
    remarks: tuple[str, ...] = ()
