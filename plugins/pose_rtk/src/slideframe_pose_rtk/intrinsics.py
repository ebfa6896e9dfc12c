"""The camera of a photograph, from the best calibration that its metadata holds."""

import math
from typing import Literal

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_pose_rtk.metadata import PhotoRecord

Calibration = Literal["measured", "design", "nominal"]

FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)  # mm; CIPA DCG-001 defines equivalent focal length by the diagonal
# Camera makers and resizing programs round sides to whole, often even, pixels; a crop changes the ratio by more.
ASPECT_TOLERANCE = 0.01
CENTER_TOLERANCE = 0.05  # optical centres of drone cameras lie within 2 % of the width from the middle


def camera_of(record: PhotoRecord) -> tuple[Camera, Calibration]:
    """Return the camera and how its focal length is known.

    measured: DewarpData, this very camera's calibration; design: CalibratedFocalLength, its type's;
    nominal: EXIF's 35 mm equivalent, good to some percent. The first two are for the full-size
    picture and scale with it; a cropped picture can't use them.

    Raises:
        InputError: the metadata holds no focal length at all.
    """
    scale = _scale(record)
    if scale and record.dewarp:
        return _measured(record, scale), "measured"
    if scale and record.calibrated_focal_length:
        return _design(record, record.calibrated_focal_length, scale), "design"
    if record.focal_length_35mm:
        return _nominal(record, record.focal_length_35mm), "nominal"
    raise InputError(
        "its metadata holds no focal length: no DewarpData, CalibratedFocalLength or FocalLengthIn35mmFilm",
        where=str(record.path),
        cure="use the files as the camera wrote them",
    )


def _scale(record: PhotoRecord) -> float | None:
    """Return stored width over full width, or None for a crop, whose place in the full picture is unknown."""
    full_width, full_height = _full_size(record)
    width, height = record.size
    if abs(width * full_height / (height * full_width) - 1) > ASPECT_TOLERANCE:
        return None
    return width / full_width


def _full_size(record: PhotoRecord) -> tuple[float, float]:
    """Return the size that the calibration is for.

    EXIF keeps it through most resizing; where a program rewrote EXIF too, twice the design optical
    centre, which lies near the middle, still tells.
    """
    stated = record.full_size or record.size
    if record.optical_center:
        doubled = 2 * record.optical_center[0], 2 * record.optical_center[1]
        if abs(doubled[0] / stated[0] - 1) > CENTER_TOLERANCE:
            return doubled
    return stated


def _measured(record: PhotoRecord, scale: float) -> Camera:
    """Use DewarpData, whose distortion is gone already where the camera has dewarped the picture."""
    assert record.dewarp is not None
    dewarp, (width, height) = record.dewarp, record.size
    return Camera(
        width=width,
        height=height,
        focal_x=dewarp.focal_x * scale,
        focal_y=dewarp.focal_y * scale,
        principal_x=width / 2 + dewarp.center_x * scale,
        principal_y=height / 2 + dewarp.center_y * scale,
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0) if record.is_dewarped else dewarp.distortion,
    )


def _design(record: PhotoRecord, focal_length: float, scale: float) -> Camera:
    width, height = record.size
    center_x, center_y = record.optical_center or (width / (2 * scale), height / (2 * scale))
    return Camera(
        width=width,
        height=height,
        focal_x=focal_length * scale,
        focal_y=focal_length * scale,
        principal_x=center_x * scale,
        principal_y=center_y * scale,
    )


def _nominal(record: PhotoRecord, focal_length_35mm: float) -> Camera:
    width, height = record.size
    focal_length = focal_length_35mm * math.hypot(width, height) / FULL_FRAME_DIAGONAL
    return Camera(
        width=width,
        height=height,
        focal_x=focal_length,
        focal_y=focal_length,
        principal_x=width / 2,
        principal_y=height / 2,
    )
