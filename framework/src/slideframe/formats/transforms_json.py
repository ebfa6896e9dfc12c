"""Cameras as the `transforms.json` of instant-ngp and nerfstudio, in and out.

A frame's `transform_matrix` is world from camera with axes x right, y up, z backward; ours are x right,
y down, z forward. Pixel (0.5, 0.5) is the centre of the upper-left pixel in both. Lengths are metres in the
survey's local frame. See https://docs.nerf.studio/quickstart/data_conventions.html.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.products import Camera

# from y up, z backward to y down, z forward
_TURN_CAMERA = np.diag([1.0, -1.0, -1.0])
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
# a rotation written with six decimals is orthogonal to this
_ORTHOGONAL = 1e-3


def write_transforms_json(views: Sequence[PosedCamera], path: Path) -> None:
    """Write the views, each with its own lens."""
    content = {"camera_model": "OPENCV", "frames": [_frame(view) for view in views]}
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def read_transforms_json(path: Path) -> list[PosedCamera]:
    """Read the views; a lens may stand in the frame or above all frames, as `fl_x` or `camera_angle_x`.

    An `applied_transform`, which nerfstudio leaves when it turns a COLMAP model, is undone.

    Raises:
        InputError: the file is missing or no such file, or a frame lacks its lens, size or pose.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        frames = content["frames"]
    except OSError as error:
        raise InputError(f"cameras can't be read: {error.strerror}", where=str(path)) from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"this is no transforms.json: {error}", where=str(path), cure="name a JSON file that has 'frames'"
        ) from error
    undo: Float64Array = np.eye(4)
    if "applied_transform" in content:
        undo[:3] = np.asarray(content["applied_transform"], np.float64)[:3]
        undo = np.asarray(np.linalg.inv(undo), np.float64)
    return [_view(index, {**content, **frame}, undo, path) for index, frame in enumerate(frames)]


def _frame(view: PosedCamera) -> dict[str, Any]:
    camera, matrix = view.camera, np.eye(4)
    matrix[:3, :3] = view.world_from_camera[:, :3] @ _TURN_CAMERA
    matrix[:3, 3] = view.world_from_camera[:, 3]
    return {
        "file_path": view.name,
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.focal_x,
        "fl_y": camera.focal_y,
        "cx": camera.principal_x,
        "cy": camera.principal_y,
        **dict(zip(_DISTORTION, camera.distortion, strict=True)),
        "transform_matrix": matrix.tolist(),
    }


def _view(index: int, frame: Mapping[str, Any], undo: Float64Array, path: Path) -> PosedCamera:
    try:
        name = str(frame.get("file_path", f"{index:06d}")).removeprefix("./")
        matrix = undo @ np.asarray(frame["transform_matrix"], np.float64).reshape(4, 4)
        rotation = matrix[:3, :3]
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < _ORTHOGONAL:
            raise ValueError("its transform_matrix is no rotation and translation")
        pose = np.column_stack([rotation @ _TURN_CAMERA, matrix[:3, 3]])
        return PosedCamera(name, _camera(frame), pose)
    except (KeyError, ValueError, TypeError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"frame {index} can't be read: {what}", where=str(path), cure="export the cameras again"
        ) from error


def _camera(frame: Mapping[str, Any]) -> Camera:
    width, height = int(frame["w"]), int(frame["h"])
    focal_x = float(frame["fl_x"]) if "fl_x" in frame else width / (2 * math.tan(float(frame["camera_angle_x"]) / 2))
    k1, k2, p1, p2, k3 = (float(frame.get(name, 0.0)) for name in _DISTORTION)
    return Camera(
        width=width,
        height=height,
        focal_x=focal_x,
        focal_y=float(frame.get("fl_y", focal_x)),
        principal_x=float(frame.get("cx", width / 2)),
        principal_y=float(frame.get("cy", height / 2)),
        distortion=(k1, k2, p1, p2, k3),
    )
