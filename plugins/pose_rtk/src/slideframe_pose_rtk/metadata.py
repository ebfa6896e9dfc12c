"""One typed record per photograph, from its EXIF, XMP and MakerNote metadata."""

import math
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from slideframe.arrays import Float64Array
from slideframe.products import Camera

AltitudeKind = Literal["ellipsoidal", "orthometric", "relative", "unknown"]
Fix = Literal["fixed", "float", "single", "none"]
PositionSource = Literal["xmp", "exif", "mrk", "ppk", "csv", "model"]
Triple = tuple[float, float, float]
Covariance = tuple[Triple, Triple, Triple]
Size = tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]

# Standard deviation in m (east, north, up) where the file states none, by kind of fix. Fixed: DJI's 1 cm + 1 ppm and
# 1.5 cm + 1 ppm doubled for antenna offset and shutter timing; the others: usual for float and single-frequency GNSS.
DEFAULT_SIGMA: dict[Fix, Triple] = {
    "fixed": (0.02, 0.02, 0.03),
    "float": (0.5, 0.5, 1.0),
    "single": (3.0, 3.0, 5.0),
    "none": (3.0, 3.0, 5.0),
}
# A receiver states its internal precision; what it states below these isn't accuracy.
LEAST_SIGMA: dict[Fix, float] = {"fixed": 0.005, "float": 0.1, "single": 1.0, "none": 1.0}
FIXED_FLAG, FLOAT_FLAGS, SINGLE_FLAG = 50, range(32, 50), 16  # DJI's RtkFlag


class _Value(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LensCalibration(_Value):
    """A measured or stated calibration, in pixels of the full-size picture.

    The centre is an offset from the middle of the picture, right and down; the coefficients are OpenCV's
    k1, k2, p1, p2, k3.
    """

    focal_x: float = Field(gt=0)
    focal_y: float = Field(gt=0)
    center_x: float
    center_y: float
    distortion: tuple[float, float, float, float, float]


class PhotoRecord(_Value):
    """What is known of one photograph's camera and place before any picture is looked at; None where nothing is.

    Attributes:
        path: the file.
        size: width and height of the stored picture, px.
        full_size: width and height that EXIF states, px; it stays when a picture is resized.
        make: the camera's maker.
        model: the camera's model name.
        serial: the camera's serial number, or the drone's where the camera's isn't stated.
        drone: the drone's own identity.
        image_source: which of a drone's cameras, in DJI's words, such as WideCamera or InfraredCamera.
        flight: identity of the flight, where the file states one.
        utc: instant of the exposure, where the file tells UTC.
        local_time: instant by the camera's clock, in an unstated time zone.
        latitude: degrees north on WGS84.
        longitude: degrees east on WGS84.
        height: m above whatever `altitude_kind` says.
        altitude_kind: ellipsoidal: above the WGS84 ellipsoid; orthometric: above a geoid, called sea level;
            relative: above the place of take-off; unknown: the file doesn't tell, or isn't to be believed.
        altitude_words: the file's own words for it, such as GpsFusionAlt.
        height_above_takeoff: m.
        position_source: where the position was taken from; a model's is an imported model's own, and no measurement.
        fix: quality of the satellite position.
        rtk_flag: DJI's: 50 fixed, 32 to 49 float, 16 single, 0 none.
        rtk_sigma: standard deviation stated by the receiver, m east, north, up.
        covariance: of the position, to weight it with, m², east, north, up; it follows the fix, see `weight`.
        gimbal: yaw, pitch and roll in degrees, see `orientation`.
        gimbal_source: xmp, makernote, or the user's csv.
        exposure_time: s.
        focal_length_35mm: equivalent focal length, mm.
        focal_length: mm.
        pixel_pitch: mm, of the full-size picture.
        calibrated_focal_length: design value, px of the full-size picture.
        optical_center: design value, px of the full-size picture.
        dewarp: measured calibration (DJI's DewarpData).
        stated_lens: calibration that Pix4D's camera tags state.
        is_dewarped: the camera has removed the distortion already.
        user_camera: the user's own calibration, at the stored picture's size.
        warnings: what is doubtful about the file, each as the end of the sentence "it …".
    """

    path: Path
    size: Size
    full_size: Size | None = None
    make: str = ""
    model: str = ""
    serial: str = ""
    drone: str = ""
    image_source: str = ""
    flight: str = ""
    utc: datetime | None = None
    local_time: datetime | None = None
    latitude: float | None = Field(default=None, ge=-90, le=90)
    longitude: float | None = Field(default=None, ge=-180, le=180)
    height: float | None = None
    altitude_kind: AltitudeKind = "unknown"
    altitude_words: str = ""
    height_above_takeoff: float | None = None
    position_source: PositionSource | None = None
    fix: Fix = "none"
    rtk_flag: int | None = None
    rtk_sigma: Triple | None = None
    covariance: Covariance = ((9.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, 0.0, 25.0))
    gimbal: Triple | None = None
    gimbal_source: Literal["xmp", "makernote", "csv"] | None = None
    exposure_time: float | None = None
    focal_length_35mm: float | None = Field(default=None, gt=0)
    focal_length: float | None = Field(default=None, gt=0)
    pixel_pitch: float | None = Field(default=None, gt=0)
    calibrated_focal_length: float | None = Field(default=None, gt=0)
    optical_center: tuple[float, float] | None = None
    dewarp: LensCalibration | None = None
    stated_lens: LensCalibration | None = None
    is_dewarped: bool = False
    user_camera: Camera | None = None
    warnings: tuple[str, ...] = ()

    @property
    def is_located(self) -> bool:
        """Tell whether latitude, longitude and height are known."""
        return self.latitude is not None and self.height is not None

    @property
    def states_position(self) -> bool:
        """Tell whether the position was measured, rather than taken over from an imported model."""
        return self.position_source != "model"

    @property
    def position_sigma(self) -> Triple:
        """Return the standard deviations to weight the position with, m east, north, up."""
        east, north, up = (math.sqrt(row[axis]) for axis, row in enumerate(self.covariance))
        return east, north, up

    @property
    def position_covariance(self) -> Float64Array:
        """Return `covariance` as (3, 3) float64, m²."""
        return np.array(self.covariance, np.float64)

    @property
    def has_zero_gimbal(self) -> bool:
        """Tell whether all three angles are exactly zero: written by cameras that don't know them."""
        return self.gimbal == (0.0, 0.0, 0.0)


def fix_of(flag: int | None) -> Fix:
    """Return the quality of the position that DJI's RtkFlag stands for; an unknown flag is no fix."""
    if flag == FIXED_FLAG:
        return "fixed"
    if flag in FLOAT_FLAGS:
        return "float"
    return "single" if flag == SINGLE_FLAG else "none"


def is_known_flag(flag: int) -> bool:
    """Tell whether DJI's manuals say what the RtkFlag means."""
    return flag in (0, SINGLE_FLAG, FIXED_FLAG) or flag in FLOAT_FLAGS


def weight(fix: Fix, stated: Triple | None) -> Covariance:
    """Return the covariance, m² east, north, up, to weight a position with.

    The fix gates it: a stated standard deviation counts as far as such a fix can be that good.
    """
    if stated is None or min(stated) <= 0:
        stated = DEFAULT_SIGMA[fix]
    return gated(fix, np.diag(np.square(stated)))


def gated(fix: Fix, covariance: Float64Array) -> Covariance:
    """Return a stated covariance (3, 3), its variances raised to what such a fix can be at best."""
    lacking = np.maximum(LEAST_SIGMA[fix] ** 2 - np.diag(covariance), 0.0)
    east, north, up = (covariance + np.diag(lacking)).tolist()
    return tuple(east), tuple(north), tuple(up)
