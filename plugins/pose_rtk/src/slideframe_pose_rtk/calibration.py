"""The user's own calibration of cameras: a TOML file with a [[camera]] table for each.

[[camera]]
model = "M3E"          # as EXIF names it; may be left out, then the table is for any camera
serial = "1581F5..."   # of one camera; may be left out
width = 5280           # of the pictures it is for; reduced ones use it in proportion
height = 3956
focal_x = 3713.29      # px
focal_y = 3713.29      # px; may be left out: as focal_x
principal_x = 2647.02  # px from the left edge; may be left out: the middle
principal_y = 1969.28  # px from the upper edge; may be left out: the middle
distortion = [-0.112575, 0.014874, -0.000085, -0.000104, -0.027064]  # k1, k2, p1, p2, k3 of OpenCV
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_pose_rtk.metadata import PhotoRecord

# Programs that resize pictures round sides to whole, often even, pixels; a crop changes the ratio by more.
ASPECT_TOLERANCE = 0.01


class CalibratedCamera(BaseModel):
    """One table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    model: str = ""
    serial: str = ""
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    focal_x: float = Field(gt=0)
    focal_y: float | None = Field(default=None, gt=0)
    principal_x: float | None = None
    principal_y: float | None = None
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def fits(self, record: PhotoRecord) -> bool:
        """Tell whether the table is meant for the photograph's camera."""
        return self.model in ("", record.model) and self.serial in ("", record.serial, record.drone)

    def camera(self, record: PhotoRecord) -> Camera | None:
        """Return the camera at the photograph's size, or None for a picture of another shape."""
        width, height = record.size
        if abs(width * self.height / (height * self.width) - 1) > ASPECT_TOLERANCE:
            return None
        scale = width / self.width
        principal_x = self.width / 2 if self.principal_x is None else self.principal_x
        principal_y = self.height / 2 if self.principal_y is None else self.principal_y
        return Camera(
            width=width,
            height=height,
            focal_x=self.focal_x * scale,
            focal_y=(self.focal_y or self.focal_x) * scale,
            principal_x=principal_x * scale,
            principal_y=principal_y * scale,
            distortion=self.distortion,
        )


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    camera: tuple[CalibratedCamera, ...] = Field(min_length=1)


def read_calibration(path: Path) -> tuple[CalibratedCamera, ...]:
    """Read the file.

    Raises:
        InputError: it isn't TOML, lacks a key, or has one too many.
    """
    cure = "see docs/survey.md: a [[camera]] table with width, height and focal_x at least"
    try:
        return _File.model_validate(tomllib.loads(path.read_text())).camera
    except ValidationError as error:
        detail = error.errors()[0]
        key = ".".join(map(str, detail["loc"]))
        raise InputError(
            f"the calibration can't be used: {key}: {detail['msg']}", where=str(path), cure=cure
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(f"the calibration can't be read: {error}", where=str(path), cure=cure) from error


def calibrated(records: Sequence[PhotoRecord], cameras: Sequence[CalibratedCamera], path: Path) -> list[PhotoRecord]:
    """Return the records with the user's camera, where a table fits; of several, the one that says most.

    Raises:
        InputError: a picture's shape isn't that of its calibration, or no table fits any photograph.
    """
    by_use = sorted(cameras, key=lambda camera: (bool(camera.serial), bool(camera.model)), reverse=True)
    used, found = set(), []
    for record in records:
        chosen = next((camera for camera in by_use if camera.fits(record)), None)
        if chosen is None:
            found.append(record)
            continue
        used.add(chosen)
        camera = chosen.camera(record)
        if camera is None:
            raise InputError(
                f"{record.path.name} has {record.size[0]} x {record.size[1]} px, and its calibration is for"
                f" {chosen.width} x {chosen.height} px, another shape",
                where=str(path),
                cure="calibrate with pictures of this shape, or name the camera that the table is for (model, serial)",
            )
        found.append(record.model_copy(update={"user_camera": camera}))
    if not used:
        seen = sorted({f"'{record.model}' (serial '{record.serial}')" for record in records})
        raise InputError(
            "no photograph is of a camera that it calibrates",
            where=str(path),
            cure=f"the photographs' cameras are: {', '.join(seen)}",
        )
    return found
