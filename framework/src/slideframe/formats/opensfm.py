"""OpenSfM's reconstruction.json, as ODM leaves it too, beside its reference_lla.json.

Shots turn world into camera coordinates by an axis times an angle, then a translation; the world is east-north-up
about the reference. Image coordinates are divided by the longer side and counted from the picture's middle. See
https://opensfm.org/docs/dataset.html and https://opensfm.org/docs/geometry.html.

ODM moves that file to reconstruction.topocentric.json and puts one in its place whose world is a projected system's
(stages/run_opensfm.py), turned by the grid's convergence and of another scale: the moved one is read where it lies.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.products import Camera, Georeference

TOPOCENTRIC, REFERENCE = "reconstruction.topocentric.json", "reference_lla.json"
PROJECTIONS = ("perspective", "simple_radial", "radial", "brown")


def read_opensfm(path: Path) -> PosedModel:
    """Read the largest of a reconstruction.json's reconstructions.

    Raises:
        InputError: the file is missing or no such file, or a lens has no counterpart.
    """
    moved = path.with_name(TOPOCENTRIC)
    path = moved if moved.is_file() else path
    reconstructions = _json(path)
    try:
        largest = max(reconstructions, key=lambda one: len(one["shots"]))
        cameras = {name: _camera(lens, path) for name, lens in largest["cameras"].items()}
        views = tuple(
            PosedCamera(name, cameras[shot["camera"]], _pose(shot)) for name, shot in sorted(largest["shots"].items())
        )
        points = [largest["points"][name] for name in sorted(largest.get("points", {}), key=_as_number)]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"this is no reconstruction.json of OpenSfM: {error!r}", where=str(path), cure="name OpenSfM's own file"
        ) from error
    others = sum(len(one["shots"]) for one in reconstructions) - len(largest["shots"])
    return PosedModel(
        views=views,
        points=np.array([point["coordinates"] for point in points], np.float64).reshape(-1, 3),
        colors=np.array([point.get("color", (128, 128, 128)) for point in points]).round().clip(0, 255).astype(np.uint8)
        if points
        else np.empty((0, 3), np.uint8),
        errors=np.full(len(points), np.nan),
        georeference=_reference(path.with_name(REFERENCE), largest),
        remarks=(f"{others} shots belong to other, smaller reconstructions and are left out",) if others else (),
    )


def _camera(lens: Mapping[str, Any], path: Path) -> Camera:
    kind = lens.get("projection_type", "perspective")
    if kind not in PROJECTIONS:
        raise InputError(
            f"the lens model '{kind}' can't be read",
            where=str(path),
            cure=f"use one of {', '.join(PROJECTIONS)}, or undistort the images",
        )
    width, height = int(lens["width"]), int(lens["height"])
    size = max(width, height)
    focal_x = float(lens["focal_x"] if "focal_x" in lens else lens["focal"])
    focal_y = float(lens.get("focal_y", focal_x))
    k1, k2, p1, p2, k3 = (float(lens.get(name, 0.0)) for name in ("k1", "k2", "p1", "p2", "k3"))
    return Camera(
        width=width,
        height=height,
        focal_x=focal_x * size,
        focal_y=focal_y * size,
        principal_x=width / 2 + float(lens.get("c_x", 0.0)) * size,
        principal_y=height / 2 + float(lens.get("c_y", 0.0)) * size,
        distortion=(k1, k2, p1, p2, k3),
    )


def _pose(shot: Mapping[str, Any]) -> Float64Array:
    """Return world from camera (3, 4)."""
    rotation = _rotation(np.array(shot["rotation"], np.float64))
    translation = np.array(shot["translation"], np.float64)
    return np.column_stack([rotation.T, -rotation.T @ translation])


def _rotation(axis_angle: Float64Array) -> Float64Array:
    """Return the (3, 3) rotation about an axis by its length in rad: Rodrigues' formula."""
    angle = float(np.linalg.norm(axis_angle))
    x, y, z = axis_angle / angle if angle > 0 else (0.0, 0.0, 0.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Float64Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation


def _reference(path: Path, reconstruction: Mapping[str, Any]) -> Georeference | None:
    """Return the origin from the file beside, or from the reconstruction itself, as newer versions write it."""
    stated = _json(path) if path.is_file() else reconstruction.get("reference_lla")
    if not stated:
        return None
    return Georeference(
        latitude=stated["latitude"], longitude=stated["longitude"], ellipsoidal_height=stated["altitude"]
    )


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"the model can't be read: {error.strerror}", where=str(path), cure="name the file") from error
    except ValueError as error:
        raise InputError(f"this is no JSON: {error}", where=str(path), cure="export the model again") from error


def _as_number(name: str) -> tuple[int, str]:
    return (int(name), "") if name.isdecimal() else (0, name)
