"""One typed record per photograph, from its EXIF and XMP metadata."""

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slideframe.errors import InputError
from slideframe_pose_rtk.exif import Exif, read_exif
from slideframe_pose_rtk.xmp import read_xmp

HeightDatum = Literal["ellipsoidal", "fused", "barometric", "unstated"]
Fix = Literal["fixed", "float", "single", "none"]
Triple = tuple[float, float, float]
Size = tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]

# P4RTK and Autel write "Longtitude".
LATITUDE = ("GpsLatitude", "GPSLatitude", "Latitude")
LONGITUDE = ("GpsLongitude", "GpsLongtitude", "GPSLongitude", "GPSLongtitude", "Longitude", "Longtitude")
GIMBAL = ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree")
RTK_SIGMA = ("RtkStdLon", "RtkStdLat", "RtkStdHgt")
OPTICAL_CENTER = ("CalibratedOpticalCenterX", "CalibratedOpticalCenterY")

HEIGHT_DATUMS: dict[str, HeightDatum] = {"RtkAlt": "ellipsoidal", "GpsFusionAlt": "fused", "PressureAlt": "barometric"}

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


class Dewarp(BaseModel):
    """DJI's measured calibration of this very camera, in pixels of the full-size picture.

    The centre is an offset from the middle of the picture; the coefficients are OpenCV's.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    focal_x: float = Field(gt=0)
    focal_y: float = Field(gt=0)
    center_x: float
    center_y: float
    distortion: tuple[float, float, float, float, float]


class PhotoRecord(BaseModel):
    """What one photograph says about its camera and place; None where it says nothing.

    Attributes:
        path: the file.
        size: width and height of the stored picture, px.
        full_size: width and height that EXIF states, px; it stays when a picture is resized.
        model: the camera's model name.
        latitude: degrees north on WGS84.
        longitude: degrees east on WGS84.
        height: m above whatever `height_datum` says.
        height_datum: ellipsoidal for RTK; fused and barometric as DJI names them; unstated: the file doesn't tell.
        height_above_takeoff: m.
        gimbal: yaw, pitch and roll in degrees, see `orientation`.
        rtk_flag: DJI's: 50 fixed, 32 to 49 float, 16 single, 0 none.
        rtk_sigma: standard deviation stated by the receiver, m east, north, up.
        focal_length_35mm: equivalent focal length, mm.
        calibrated_focal_length: design value, px of the full-size picture.
        optical_center: design value, px of the full-size picture.
        dewarp: measured calibration.
        is_dewarped: the camera has removed the distortion already.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    path: Path
    size: Size
    full_size: Size | None = None
    model: str = ""
    latitude: float | None = Field(default=None, ge=-90, le=90)
    longitude: float | None = Field(default=None, ge=-180, le=180)
    height: float | None = None
    height_datum: HeightDatum = "unstated"
    height_above_takeoff: float | None = None
    gimbal: Triple | None = None
    rtk_flag: int | None = None
    rtk_sigma: Triple | None = None
    focal_length_35mm: float | None = Field(default=None, gt=0)
    calibrated_focal_length: float | None = Field(default=None, gt=0)
    optical_center: tuple[float, float] | None = None
    dewarp: Dewarp | None = None
    is_dewarped: bool = False

    @property
    def fix(self) -> Fix:
        """Return the quality of the satellite position."""
        flag = self.rtk_flag or 0
        if flag == 50:
            return "fixed"
        if 32 <= flag < 50:
            return "float"
        return "single" if flag == 16 else "none"

    @property
    def position_sigma(self) -> Triple:
        """Return the standard deviation to weight the position with, m east, north, up."""
        if self.rtk_sigma is None or min(self.rtk_sigma) <= 0:
            return DEFAULT_SIGMA[self.fix]
        east, north, up = (max(sigma, LEAST_SIGMA[self.fix]) for sigma in self.rtk_sigma)
        return east, north, up

    @property
    def has_zero_gimbal(self) -> bool:
        """Tell whether all three angles are exactly zero: written by cameras that don't know them."""
        return self.gimbal == (0.0, 0.0, 0.0)


def read_record(path: Path) -> PhotoRecord:
    """Read one photograph's metadata; pixels stay undecoded.

    Raises:
        InputError: the file isn't a readable picture, or its metadata can't be true.
    """
    exif = read_exif(path)
    xmp = read_xmp(path)
    try:
        return _record(path, exif, xmp)
    except ValidationError as error:
        detail = error.errors()[0]
        raise InputError(
            f"its metadata can't be true: {'.'.join(map(str, detail['loc']))} is {detail['input']} ({detail['msg']})",
            where=str(path),
            cure="remove the photograph, or repair its metadata",
        ) from error


def _record(path: Path, exif: Exif, xmp: dict[str, str]) -> PhotoRecord:
    latitude, longitude = _position(exif, xmp)
    absolute = _number(xmp, "AbsoluteAltitude")
    gimbal = _numbers(xmp, GIMBAL)
    sigma = _numbers(xmp, RTK_SIGMA)
    center = _numbers(xmp, OPTICAL_CENTER)
    flag = _number(xmp, "RtkFlag")
    return PhotoRecord(
        path=path,
        size=exif.size,
        full_size=exif.full_size,
        model=exif.model,
        latitude=latitude,
        longitude=longitude,
        height=exif.height if absolute is None else absolute,
        height_datum=_height_datum(xmp, flag) if absolute is not None else "unstated",
        height_above_takeoff=_number(xmp, "RelativeAltitude"),
        gimbal=(gimbal[0], gimbal[1], gimbal[2]) if gimbal else None,
        rtk_flag=None if flag is None else int(flag),
        rtk_sigma=(sigma[0], sigma[1], sigma[2]) if sigma else None,
        focal_length_35mm=exif.focal_length_35mm,
        calibrated_focal_length=_number(xmp, "CalibratedFocalLength"),
        optical_center=(center[0], center[1]) if center else None,
        dewarp=_dewarp(xmp.get("DewarpData", "")),
        is_dewarped=_number(xmp, "DewarpFlag") == 1,
    )


def _position(exif: Exif, xmp: dict[str, str]) -> tuple[float | None, float | None]:
    """Return XMP's position, which has more digits, else EXIF's; (0, 0) is what cameras write without a fix."""
    stated = _first_number(xmp, LATITUDE), _first_number(xmp, LONGITUDE)
    latitude, longitude = stated if None not in stated else (exif.latitude, exif.longitude)
    if xmp.get("GpsStatus") == "Invalid" or latitude is None or longitude is None or latitude == longitude == 0:
        return None, None
    return latitude, longitude


def _height_datum(xmp: dict[str, str], flag: float | None) -> HeightDatum:
    """Trust AltitudeType; without one (P4RTK, P4M) an RTK position has an ellipsoidal height."""
    if "AltitudeType" in xmp:
        return HEIGHT_DATUMS.get(xmp["AltitudeType"], "unstated")
    return "ellipsoidal" if flag else "unstated"


def _dewarp(text: str) -> Dewarp | None:
    """Read ` 2022-03-02;fx,fy,cx,cy,k1,k2,p1,p2,k3`; anything else, such as all zeros, is no calibration."""
    try:
        values = [float(number) for number in text.rpartition(";")[2].split(",")]
    except ValueError:
        return None
    if len(values) != 9 or not all(map(math.isfinite, values)) or min(values[:2]) <= 0:
        return None
    focal_x, focal_y, center_x, center_y, k1, k2, p1, p2, k3 = values
    return Dewarp(
        focal_x=focal_x, focal_y=focal_y, center_x=center_x, center_y=center_y, distortion=(k1, k2, p1, p2, k3)
    )


def _number(xmp: dict[str, str], name: str) -> float | None:
    """Read a signed decimal such as `+349.58`; what isn't a finite number is as good as absent."""
    try:
        value = float(xmp[name])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _first_number(xmp: dict[str, str], names: tuple[str, ...]) -> float | None:
    return next((value for name in names if (value := _number(xmp, name)) is not None), None)


def _numbers(xmp: dict[str, str], names: tuple[str, ...]) -> list[float] | None:
    """Return all of them or none."""
    values = [value for name in names if (value := _number(xmp, name)) is not None]
    return values if len(values) == len(names) else None
