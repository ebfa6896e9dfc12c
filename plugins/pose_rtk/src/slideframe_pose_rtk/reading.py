"""Reads one photograph's record, in the words of each maker."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slideframe.errors import InputError
from slideframe_pose_rtk.exif import Exif, read_exif
from slideframe_pose_rtk.makernote import gimbal_from_makernote
from slideframe_pose_rtk.metadata import (
    AltitudeKind,
    LensCalibration,
    PhotoRecord,
    Triple,
    fix_of,
    is_known_flag,
    weight,
)
from slideframe_pose_rtk.orientation import gimbal_angles, world_from_downward_camera
from slideframe_pose_rtk.xmp import Xmp, read_xmp

Properties = dict[str, str]

# P4RTK and Autel write "Longtitude".
LATITUDE = ("GpsLatitude", "GPSLatitude", "Latitude", "skydio:Latitude")
LONGITUDE = (
    *("GpsLongitude", "GpsLongtitude", "GPSLongitude", "GPSLongtitude", "Longitude", "Longtitude"),
    "skydio:Longitude",
)
ABSOLUTE = ("AbsoluteAltitude", "skydio:AbsoluteAltitude")
RELATIVE = ("RelativeAltitude", "skydio:RelativeAltitude", "camera:AboveGroundAltitude")
# Yaw, pitch, roll in north-east-down, turned z, y, x, by maker.
GIMBAL = (
    ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"),
    ("parrot:CameraYawDegree", "parrot:CameraPitchDegree", "parrot:CameraRollDegree"),
    ("skydio:CameraOrientationNED/Yaw", "skydio:CameraOrientationNED/Pitch", "skydio:CameraOrientationNED/Roll"),
)
PIX4D_ANGLES = ("camera:Yaw", "camera:Pitch", "camera:Roll")
RTK_SIGMA = ("RtkStdLon", "RtkStdLat", "RtkStdHgt")
PIX4D_SIGMA = ("camera:GPSXYAccuracy", "camera:GPSXYAccuracy", "camera:GPSZAccuracy")
OPTICAL_CENTER = ("CalibratedOpticalCenterX", "CalibratedOpticalCenterY")
CAMERA_SERIAL = ("CameraSerialNumber", "CameraSN", "camera:SerialNumber", "skydio:CameraSerial")
DRONE_SERIAL = ("DroneSerialNumber", "DroneSN", "DroneID", "skydio:VehicleSerial")
FLIGHT = ("FlightUUID", "camera:FlightUUID", "skydio:FlightID")

# DJI's AltitudeType; the fused and the barometric height lie on no stated level.
ALTITUDE_TYPES: dict[str, AltitudeKind] = {"RtkAlt": "ellipsoidal"}
# They write "above sea level" into EXIF whatever the level is.
CARELESS_MAKERS = ("dji", "hasselblad", "autel", "camera")
WGS84_NAMES = ("", "WGS84", "WGS1984")


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


def _record(path: Path, exif: Exif, xmp: Xmp) -> PhotoRecord:
    properties = xmp.properties
    gimbal, gimbal_source = _gimbal(path, exif, properties)
    record: dict[str, Any] = {
        "path": path,
        "size": exif.size,
        "full_size": exif.full_size,
        "make": properties.get("tiff:Make") or exif.make,
        "model": exif.model or properties.get("tiff:Model", ""),
        "serial": _first(properties, CAMERA_SERIAL) or exif.serial or _first(properties, DRONE_SERIAL),
        "drone": _first(properties, DRONE_SERIAL),
        "image_source": properties.get("ImageSource", ""),
        "flight": _first(properties, FLIGHT),
        "utc": _instant(properties) or exif.utc,
        "local_time": exif.local_time,
        "exposure_time": exif.exposure_time,
        "gimbal": gimbal,
        "gimbal_source": gimbal_source,
        **_place(exif, properties),
        **_accuracy(properties),
        **_lens(exif, properties),
    }
    return PhotoRecord(**record, warnings=_warnings(exif, xmp, gimbal))


def _place(exif: Exif, properties: Properties) -> dict[str, Any]:
    """Return XMP's position, which has more digits, else EXIF's; (0, 0) is what cameras write without a fix."""
    stated = _first_number(properties, LATITUDE), _first_number(properties, LONGITUDE)
    latitude, longitude = stated if None not in stated else (exif.latitude, exif.longitude)
    height, kind, words = _altitude(exif, properties)
    place: dict[str, Any] = {
        "height": height,
        "altitude_kind": kind,
        "altitude_words": words,
        "height_above_takeoff": _first_number(properties, RELATIVE),
    }
    if properties.get("GpsStatus") == "Invalid" or latitude is None or longitude is None or latitude == longitude == 0:
        return place
    source = "xmp" if None not in stated else "exif"
    return place | {"latitude": latitude, "longitude": longitude, "position_source": source}


def _altitude(exif: Exif, properties: Properties) -> tuple[float | None, AltitudeKind, str]:
    """Return the height, what it is measured from, and the file's words for that.

    AltitudeType counts; P4RTK and P4M have none, and an ellipsoidal height where their receiver has a position.
    """
    absolute = _first_number(properties, ABSOLUTE)
    if absolute is not None:
        words = properties.get("AltitudeType", "")
        flag = _number(properties, "RtkFlag")
        if not words and flag:
            return absolute, "ellipsoidal", f"RtkFlag {flag:.0f}"
        return absolute, ALTITUDE_TYPES.get(words, "unknown"), words
    if exif.height is not None:
        words = f"EXIF: {exif.altitude_reference}" if exif.altitude_reference else "EXIF"
        if exif.altitude_reference == "ellipsoid":
            return exif.height, "ellipsoidal", words
        careful = exif.make and not exif.make.lower().startswith(CARELESS_MAKERS)
        return exif.height, "orthometric" if careful and exif.altitude_reference else "unknown", words
    relative = _first_number(properties, RELATIVE)
    return relative, "unknown" if relative is None else "relative", "" if relative is None else "RelativeAltitude"


def _accuracy(properties: Properties) -> dict[str, Any]:
    """Return fix, flag, stated deviations and the covariance that follows.

    Pix4D's accuracy tags are a statement about the position as it stands; no flag gates them.
    """
    number = _number(properties, "RtkFlag")
    flag = None if number is None else int(number)
    fix = fix_of(flag)
    sigma = _triple(properties, RTK_SIGMA)
    stated = _triple(properties, PIX4D_SIGMA) if flag is None else None
    covariance = weight("fixed", stated) if stated and min(stated) > 0 else weight(fix, sigma)
    return {"rtk_flag": flag, "fix": fix, "rtk_sigma": sigma or stated, "covariance": covariance}


def _gimbal(path: Path, exif: Exif, properties: Properties) -> tuple[Triple | None, str | None]:
    """Return yaw, pitch, roll and where they stand: XMP's, DJI's MakerNote's where XMP has none or zeros."""
    stated = next((angles for names in GIMBAL if (angles := _triple(properties, names))), None)
    stated = stated or _pix4d_gimbal(exif, properties)
    if (stated is None or not any(stated)) and exif.maker_note:
        noted = gimbal_from_makernote(path, exif.maker_note)
        if noted and any(noted):
            return noted, "makernote"
    return stated, "xmp" if stated else None


def _pix4d_gimbal(exif: Exif, properties: Properties) -> Triple | None:
    """Return the same orientation as Pix4D's angles, in which zero looks straight down.

    Some Autel firmware writes DJI's angles under these names: a camera that looked backwards and up again
    (a negative pitch) can't be what a drone means.
    """
    angles = _triple(properties, PIX4D_ANGLES)
    if angles is None:
        return None
    if angles[1] < 0 and exif.make.lower().startswith(("autel", "camera")):
        return angles
    return gimbal_angles(world_from_downward_camera(*angles))


def _lens(exif: Exif, properties: Properties) -> dict[str, Any]:
    center = [_number(properties, name) for name in OPTICAL_CENTER]
    return {
        "focal_length_35mm": exif.focal_length_35mm,
        "focal_length": exif.focal_length,
        "pixel_pitch": exif.pixel_pitch,
        "calibrated_focal_length": _number(properties, "CalibratedFocalLength"),
        "optical_center": None if None in center else tuple(center),
        "dewarp": _dewarp(properties.get("DewarpData", "")),
        "stated_lens": _pix4d_lens(exif, properties),
        "is_dewarped": _number(properties, "DewarpFlag") == 1,
    }


def _dewarp(text: str) -> LensCalibration | None:
    """Read ` 2022-03-02;fx,fy,cx,cy,k1,k2,p1,p2,k3`; anything else, such as all zeros, is no calibration."""
    values = _list(text.rpartition(";")[2])
    if len(values) != 9 or min(values[:2]) <= 0:
        return None
    focal_x, focal_y, center_x, center_y, k1, k2, p1, p2, k3 = values
    return LensCalibration(
        focal_x=focal_x, focal_y=focal_y, center_x=center_x, center_y=center_y, distortion=(k1, k2, p1, p2, k3)
    )


def _pix4d_lens(exif: Exif, properties: Properties) -> LensCalibration | None:
    """Read Pix4D's perspective model: mm on the sensor from its upper left corner, and R1, R2, R3, T1, T2."""
    focal_length = _number(properties, "camera:PerspectiveFocalLength")
    if not focal_length or focal_length <= 0 or not exif.pixel_pitch or not exif.full_size:
        return None
    if properties.get("camera:PerspectiveFocalLengthUnits", "mm") != "mm":
        return None
    width, height = exif.full_size
    center = _list(properties.get("camera:PrincipalPoint", ""))
    radial_and_tangential = _list(properties.get("camera:PerspectiveDistortion", "0,0,0,0,0"))
    if len(center) != 2 or len(radial_and_tangential) != 5:
        return None
    r1, r2, r3, t1, t2 = radial_and_tangential
    return LensCalibration(
        focal_x=focal_length / exif.pixel_pitch,
        focal_y=focal_length / exif.pixel_pitch,
        center_x=center[0] / exif.pixel_pitch - width / 2,
        center_y=center[1] / exif.pixel_pitch - height / 2,
        distortion=(r1, r2, t1, t2, r3),
    )


def _warnings(exif: Exif, xmp: Xmp, gimbal: Triple | None) -> tuple[str, ...]:
    """Return what is doubtful about the file."""
    warnings = []
    if xmp.disagreements:
        names = ", ".join(xmp.disagreements)
        warnings.append(f"holds XMP packets that disagree (the first counts) about {names}")
    if exif.map_datum.upper().replace("-", "").replace(" ", "") not in WGS84_NAMES:
        warnings.append(f"states its position in {exif.map_datum}, which is taken for WGS84")
    if exif.orientation != 1:
        warnings.append(f"is marked to be shown turned (Orientation {exif.orientation}); its pixels are used as stored")
    flag = _number(xmp.properties, "RtkFlag")
    if flag is not None and not is_known_flag(int(flag)):
        warnings.append(f"has an RtkFlag of {flag:.0f}, which isn't known and counts as no fix")
    if gimbal and gimbal[1] > 0:
        warnings.append("looks above the horizon")
    if xmp.properties.get("SurveyingMode") == "0":
        warnings.append("was taken in a mode that isn't accurate enough for surveys, says the drone (SurveyingMode 0)")
    return tuple(warnings)


def _instant(properties: Properties) -> datetime | None:
    """Read DJI's UTCAtExposure."""
    try:
        instant = datetime.fromisoformat(properties.get("UTCAtExposure", ""))
    except ValueError:
        return None
    return instant.replace(tzinfo=UTC) if instant.tzinfo is None else instant.astimezone(UTC)


def _number(properties: Properties, name: str) -> float | None:
    """Read a signed decimal such as `+349.58` or a fraction; what isn't a finite number is as good as absent."""
    numerator, slash, denominator = properties.get(name, "").partition("/")
    try:
        value = float(numerator) / (float(denominator) if slash else 1.0)
    except (ValueError, ZeroDivisionError):
        return None
    return value if math.isfinite(value) else None


def _first_number(properties: Properties, names: tuple[str, ...]) -> float | None:
    return next((value for name in names if (value := _number(properties, name)) is not None), None)


def _first(properties: Properties, names: tuple[str, ...]) -> str:
    return next((properties[name] for name in names if properties.get(name)), "")


def _triple(properties: Properties, names: tuple[str, str, str]) -> Triple | None:
    """Return all three or none."""
    first, second, third = (_number(properties, name) for name in names)
    return None if first is None or second is None or third is None else (first, second, third)


def _list(text: str) -> list[float]:
    """Read numbers between commas; none where one of them isn't a finite number."""
    try:
        values = [float(number) for number in text.split(",")]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []
