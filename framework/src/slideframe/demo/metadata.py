"""EXIF and XMP of a demo photograph, in the form in which the drone writes them."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
from PIL import ExifTags, Image, TiffImagePlugin

from slideframe.arrays import Float64Array
from slideframe.demo import lens

MODEL = "M3E"
LOCAL_TIME = timezone(timedelta(hours=8))
TAKE_OFF = datetime(2024, 11, 7, 10, 12, 5, 480000, tzinfo=LOCAL_TIME)
SECONDS_BETWEEN_PHOTOGRAPHS = 3.4
_RATIONAL = TiffImagePlugin.IFDRational


@dataclass(frozen=True)
class Shot:
    """What the drone knows of one photograph.

    Attributes:
        number: counts from 1.
        geodetic: latitude, longitude (degrees) and ellipsoidal height (m) as RTK gives them.
        above_take_off: height above the place of take-off, m.
        gimbal: yaw, pitch, roll as reported, degrees.
        position_sigma: standard deviations east, north, up, m.
    """

    number: int
    geodetic: Float64Array
    above_take_off: float
    gimbal: Float64Array
    position_sigma: Float64Array

    @property
    def time(self) -> datetime:
        """Instant of the exposure."""
        return TAKE_OFF + timedelta(seconds=40 + SECONDS_BETWEEN_PHOTOGRAPHS * self.number)

    @property
    def file_name(self) -> str:
        """The name that the drone gives."""
        return f"DJI_{self.time:%Y%m%d%H%M%S}_{self.number:04d}_V.JPG"


def exif_of(shot: Shot) -> Image.Exif:
    """Build the EXIF block. The pixel size is the camera's own, as a reduced copy keeps it."""
    latitude, longitude, height = shot.geodetic
    base, base_ifd, gps = ExifTags.Base, ExifTags.IFD, ExifTags.GPS
    stamp = f"{shot.time:%Y:%m:%d %H:%M:%S}"
    exif = Image.Exif()
    exif.update(
        {base.Make: "DJI", base.Model: MODEL, base.Orientation: 1, base.DateTime: stamp, base.Software: "10.00.12.01"}
    )
    exif.get_ifd(base_ifd.Exif).update(
        {
            base.ExposureTime: _RATIONAL(1, 1000),
            base.FNumber: _RATIONAL(28, 10),
            base.ISOSpeedRatings: 100,
            base.DateTimeOriginal: stamp,
            base.DateTimeDigitized: stamp,
            base.FocalLength: _RATIONAL(round(100 * lens.FOCAL_LENGTH), 100),
            base.FocalLengthIn35mmFilm: 24,
            base.ExifImageWidth: lens.FULL_WIDTH,
            base.ExifImageHeight: lens.FULL_HEIGHT,
        }
    )
    exif.get_ifd(base_ifd.GPSInfo).update(
        {
            gps.GPSVersionID: b"\x02\x03\x00\x00",
            gps.GPSLatitudeRef: "N" if latitude >= 0 else "S",
            gps.GPSLatitude: _degrees_minutes_seconds(latitude),
            gps.GPSLongitudeRef: "E" if longitude >= 0 else "W",
            gps.GPSLongitude: _degrees_minutes_seconds(longitude),
            gps.GPSAltitudeRef: b"\x00" if height >= 0 else b"\x01",
            gps.GPSAltitude: _RATIONAL(round(1000 * abs(height)), 1000),
            gps.GPSMapDatum: "WGS-84",
        }
    )
    return exif


def xmp_of(shot: Shot) -> bytes:
    """Build the XMP packet, every value an attribute."""
    drone = "".join(f'\n   drone-dji:{name}="{value}"' for name, value in _drone_values(shot).items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '  <rdf:Description rdf:about="DJI Meta Data"\n'
        '    xmlns:tiff="http://ns.adobe.com/tiff/1.0/"\n    xmlns:xmp="http://ns.adobe.com/xap/1.0/"\n'
        '    xmlns:dc="http://purl.org/dc/elements/1.1/"\n    xmlns:crs="http://ns.adobe.com/camera-raw-settings/1.0/"\n'
        '    xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"\n'
        f'   xmp:ModifyDate="{shot.time:%Y-%m-%d}"\n   xmp:CreateDate="{shot.time:%Y-%m-%d}"\n'
        f'   tiff:Make="DJI"\n   tiff:Model="{MODEL}"\n   dc:format="image/jpg"{drone}\n'
        '   crs:Version="7.0"\n   crs:HasSettings="False"\n   crs:HasCrop="False"\n   crs:AlreadyApplied="False">\n'
        '  </rdf:Description>\n </rdf:RDF>\n</x:xmpmeta>\n<?xpacket end="w"?>'
    ).encode()


def dewarp_data() -> str:
    """Return the factory's calibration: date;fx,fy,cx,cy,k1,k2,p1,p2,k3 at full size."""
    numbers = (*lens.MEASURED_FOCAL, *lens.PRINCIPAL_OFFSET, *lens.DISTORTION)
    return "2023-05-18;" + ",".join(f"{number:.12f}" for number in numbers)


def _drone_values(shot: Shot) -> dict[str, str]:
    yaw, pitch, roll = shot.gimbal
    east, north, up = shot.position_sigma
    return {
        "Version": "1.5",
        "ImageSource": "WideCamera",
        "GpsStatus": "RTK",
        "AltitudeType": "RtkAlt",
        # nine decimals of a degree are 0.1 mm
        "GpsLatitude": f"{shot.geodetic[0]:+.9f}",
        "GpsLongitude": f"{shot.geodetic[1]:+.9f}",
        "AbsoluteAltitude": f"{shot.geodetic[2]:+.3f}",
        "RelativeAltitude": f"{shot.above_take_off:+.3f}",
        "GimbalRollDegree": f"{roll:+.2f}",
        "GimbalYawDegree": f"{yaw:+.2f}",
        "GimbalPitchDegree": f"{pitch:+.2f}",
        "FlightRollDegree": "+0.40",
        "FlightYawDegree": f"{yaw + 0.3:+.2f}",
        "FlightPitchDegree": "-1.70",
        "FlightXSpeed": "+0.0",
        "FlightYSpeed": "+0.0",
        "FlightZSpeed": "+0.0",
        "CamReverse": "0",
        "GimbalReverse": "0",
        "RtkFlag": "50",
        "RtkStdLon": f"{east:.5f}",
        "RtkStdLat": f"{north:.5f}",
        "RtkStdHgt": f"{up:.5f}",
        "RtkDiffAge": "1.00000",
        "CalibratedFocalLength": f"{lens.DESIGN_FOCAL:.6f}",
        "CalibratedOpticalCenterX": f"{lens.FULL_WIDTH / 2:.6f}",
        "CalibratedOpticalCenterY": f"{lens.FULL_HEIGHT / 2:.6f}",
        "DewarpFlag": "0",
        "DewarpData": dewarp_data(),
        "UTCAtExposure": f"{shot.time.astimezone(UTC):%Y-%m-%dT%H:%M:%S.%f}",
        "ShutterType": "Mechanical",
        "DroneModel": MODEL,
    }


def _degrees_minutes_seconds(angle: float) -> tuple[TiffImagePlugin.IFDRational, ...]:
    """Split an angle as GPS tags want it, to a ten thousandth of a second (3 mm)."""
    total = int(np.round(abs(angle) * 36_000_000))
    degrees, rest = divmod(total, 36_000_000)
    minutes, seconds = divmod(rest, 600_000)
    return _RATIONAL(degrees, 1), _RATIONAL(minutes, 1), _RATIONAL(seconds, 10_000)
