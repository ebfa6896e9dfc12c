"""COLMAP's binary model: cameras.bin, images.bin and points3D.bin, little-endian, as COLMAP's scripts/python read it.

Positions are in the survey's local frame, metres; pixels, quaternions and translations as in the text model.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.colmap import (
    PARAMETERS,
    camera_of_parameters,
    common_folder,
    parameters_of_camera,
    quaternion_of,
    world_from_camera_of,
)
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.products import Camera, Survey

# The numbers that COLMAP gives to its lens models.
MODEL_NUMBERS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4, "FULL_OPENCV": 6}
_NAMES = {number: name for name, number in MODEL_NUMBERS.items()}

_CAMERA, _IMAGE = struct.Struct("<IiQQ"), struct.Struct("<I7dI")
_POINT, _COUNT = struct.Struct("<Q3d3BdQ"), struct.Struct("<Q")
_SIGHTING_BYTES, _TRACK_BYTES = 24, 8


def write_colmap_binary(survey: Survey, folder: Path) -> None:
    """Write the survey as a COLMAP binary model; points carry no tracks, because a survey keeps none.

    Images are named by their paths below the folder that holds them all, to be given as COLMAP's image path.
    """
    folder.mkdir(parents=True, exist_ok=True)
    common = common_folder(survey)
    with (folder / "cameras.bin").open("wb") as file:
        file.write(_COUNT.pack(len(survey.cameras)))
        for number, camera in enumerate(survey.cameras, 1):
            model, values = parameters_of_camera(camera)
            file.write(_CAMERA.pack(number, MODEL_NUMBERS[model], camera.width, camera.height))
            file.write(struct.pack(f"<{len(values)}d", *values))
    with (folder / "images.bin").open("wb") as file:
        file.write(_COUNT.pack(len(survey.photographs)))
        for number, (photograph, pose) in enumerate(zip(survey.photographs, survey.world_from_camera, strict=True), 1):
            rotation = pose[:, :3].T
            file.write(_IMAGE.pack(number, *quaternion_of(rotation), *(-rotation @ pose[:, 3]), photograph.camera + 1))
            file.write(photograph.path.relative_to(common).as_posix().encode() + b"\0" + _COUNT.pack(0))
    with (folder / "points3D.bin").open("wb") as file:
        file.write(_COUNT.pack(len(survey.sparse_points)))
        rows = zip(survey.sparse_points, survey.sparse_colors, survey.sparse_errors, strict=True)
        for number, (place, color, error) in enumerate(rows, 1):
            file.write(_POINT.pack(number, *map(float, place), *map(int, color), float(error), 0))


def read_colmap_binary(folder: Path) -> PosedModel:
    """Read a COLMAP binary model, images and points in the order of their numbers.

    Raises:
        InputError: a file is missing or breaks off, or a lens model has no counterpart.
    """
    cameras = dict(_cameras(_Bytes(folder / "cameras.bin")))
    images = sorted(_images(_Bytes(folder / "images.bin")), key=lambda image: image[0])
    points = np.array(sorted(_points(_Bytes(folder / "points3D.bin"))), np.float64).reshape(-1, 8)
    missing = {camera for _, camera, _, _ in images} - set(cameras)
    if missing:
        raise InputError(
            f"an image names camera {min(missing)}, which isn't there",
            where=str(folder / "images.bin"),
            cure="export the model again",
        )
    return PosedModel(
        views=tuple(PosedCamera(name, cameras[camera], pose) for _, camera, name, pose in images),
        points=points[:, 1:4],
        colors=points[:, 4:7].astype(np.uint8),
        errors=points[:, 7],
    )


class _Bytes:
    """A file read from its start on."""

    def __init__(self, path: Path) -> None:
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise InputError(
                f"the COLMAP model is incomplete: {error.strerror}", where=str(path), cure="export it again"
            ) from error
        self.path, self.place = path, 0

    def take(self, layout: struct.Struct) -> tuple[int | float, ...]:
        if self.place + layout.size > len(self.data):
            raise self.cut()
        values: tuple[int | float, ...] = layout.unpack_from(self.data, self.place)
        self.place += layout.size
        return values

    def count(self) -> int:
        return int(self.take(_COUNT)[0])

    def skip(self, size: int) -> None:
        if self.place + size > len(self.data):
            raise self.cut()
        self.place += size

    def name(self) -> str:
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise self.cut()
        text = self.data[self.place : end].decode("utf-8", "replace")
        self.place = end + 1
        return text

    def cut(self) -> InputError:
        return InputError("the COLMAP model breaks off", where=str(self.path), cure="export it again")


def _cameras(file: _Bytes) -> Iterator[tuple[int, Camera]]:
    for _ in range(file.count()):
        number, model, width, height = file.take(_CAMERA)
        name = _NAMES.get(int(model), f"number {model}")
        if name not in PARAMETERS:
            raise InputError(
                f"the lens model '{name}' can't be read",
                where=str(file.path),
                cure=f"use one of {', '.join(PARAMETERS)}, or undistort the images",
            )
        values = [float(value) for value in file.take(struct.Struct(f"<{max(PARAMETERS[name]) + 1}d"))]
        yield int(number), camera_of_parameters(name, int(width), int(height), values, str(file.path))


def _images(file: _Bytes) -> Iterator[tuple[int, int, str, Float64Array]]:
    for _ in range(file.count()):
        number, *pose, camera = file.take(_IMAGE)
        name = file.name()
        file.skip(_SIGHTING_BYTES * file.count())
        yield int(number), int(camera), name, world_from_camera_of(np.array(pose, np.float64))


def _points(file: _Bytes) -> Iterator[tuple[int | float, ...]]:
    for _ in range(file.count()):
        *point, track_length = file.take(_POINT)
        file.skip(_TRACK_BYTES * int(track_length))
        yield tuple(point)
