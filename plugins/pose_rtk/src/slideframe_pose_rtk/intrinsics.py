"""The camera of a photograph, from the best calibration that its metadata holds."""

import math
from typing import Literal

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_pose_rtk.metadata import LensCalibration, PhotoRecord

Calibration = Literal["user", "measured", "design", "nominal"]

FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)  # mm; CIPA DCG-001 defines equivalent focal length by the diagonal
# Camera makers and resizing programs round sides to whole, often even, pixels; a crop changes the ratio by more.
ASPECT_TOLERANCE = 0.01
# FocalPlaneXResolution is exact where it is right; beside the rounded equivalent focal length, wrong values show.
PITCH_TOLERANCE = 0.1
UPENDED_QUARTERS = 1  # the turn that is supposed of a picture stood on end; half of them prove to be turned by 3
CENTER_TOLERANCE = 0.05  # optical centres of drone cameras lie within 2 % of the width from the middle


def camera_of(record: PhotoRecord) -> tuple[Camera, Calibration]:
    """Return the camera and how its focal length is known.

    user: the user's calibration; measured: DewarpData, this very camera's; design: what Pix4D's tags or
    CalibratedFocalLength state of its type; nominal: EXIF's focal length, good to some percent. Measured and
    design ones are for the full-size picture and scale with it; a cropped picture can't use them. One that was stood
    on end uses them turned one way, until the others show that it was the other, see `turned`.

    Raises:
        InputError: the metadata holds no focal length at all.
    """
    if record.user_camera:
        return record.user_camera, "user"
    if is_upended(record):
        camera, calibration = camera_of(record.model_copy(update={"size": record.size[::-1]}))
        return turned_camera(camera, UPENDED_QUARTERS), calibration
    scale = _scale(record)
    if scale and record.dewarp:
        return _calibrated(record, record.dewarp, scale), "measured"
    if scale and record.stated_lens:
        return _calibrated(record, record.stated_lens, scale), "design"
    if scale and record.calibrated_focal_length:
        return _design(record, record.calibrated_focal_length, scale), "design"
    focal_length = _nominal_focal_length(record, scale)
    if focal_length:
        return _nominal(record, focal_length), "nominal"
    raise InputError(
        "its metadata holds no focal length: no DewarpData, CalibratedFocalLength, FocalLengthIn35mmFilm, or"
        " FocalLength with FocalPlaneXResolution",
        where=str(record.path),
        cure="use the files as the camera wrote them, or give a calibration",
    )


def is_upended(record: PhotoRecord) -> bool:
    """Tell whether the stored picture has the full picture's sides in the other order: a program stood it on end."""
    (width, height), (full_width, full_height) = record.size, _full_size(record)
    if (width > height) == (full_width > full_height) or width == height:
        return False
    return abs(width * full_width / (height * full_height) - 1) <= ASPECT_TOLERANCE


def turned_camera(camera: Camera, quarters: int) -> Camera:
    """Return the camera whose right is the given one's down, once for each of `quarters`: its picture turned so.

    A pixel (u, v) from the middle goes to (v, -u), and with it the principal point and the vector (p2, p1), since
    OpenCV's tangential displacement is that vector times r^2 plus twice its projection on (x, y) times (x, y).
    """
    for _ in range(quarters % 4):
        k1, k2, p1, p2, k3 = camera.distortion
        camera = Camera(
            width=camera.height,
            height=camera.width,
            focal_x=camera.focal_y,
            focal_y=camera.focal_x,
            principal_x=camera.principal_y,
            principal_y=camera.width - camera.principal_x,
            distortion=(k1, k2, -p2, p1, k3),
        )
    return camera


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


def _calibrated(record: PhotoRecord, lens: LensCalibration, scale: float) -> Camera:
    """Use a calibration, whose distortion is gone already where the camera has dewarped the picture."""
    width, height = record.size
    return Camera(
        width=width,
        height=height,
        focal_x=lens.focal_x * scale,
        focal_y=lens.focal_y * scale,
        principal_x=width / 2 + lens.center_x * scale,
        principal_y=height / 2 + lens.center_y * scale,
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0) if record.is_dewarped else lens.distortion,
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


def _nominal_focal_length(record: PhotoRecord, scale: float | None) -> float | None:
    """Return EXIF's focal length in px of the stored picture."""
    equivalent = None
    if record.focal_length_35mm:
        equivalent = record.focal_length_35mm * math.hypot(*record.size) / FULL_FRAME_DIAGONAL
    if scale and record.focal_length and record.pixel_pitch:
        focal_length = record.focal_length / record.pixel_pitch * scale
        if equivalent is None or abs(focal_length / equivalent - 1) < PITCH_TOLERANCE:
            return focal_length
    return equivalent


def _nominal(record: PhotoRecord, focal_length: float) -> Camera:
    width, height = record.size
    return Camera(
        width=width,
        height=height,
        focal_x=focal_length,
        focal_y=focal_length,
        principal_x=width / 2,
        principal_y=height / 2,
    )
