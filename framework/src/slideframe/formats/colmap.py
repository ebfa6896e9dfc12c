"""COLMAP's text model: cameras.txt, images.txt and points3D.txt, as https://colmap.github.io/format.html describes it.

Positions are in the survey's local frame, metres. COLMAP's quaternions (w, x, y, z) and translations turn
world into camera coordinates; its pixel (0.5, 0.5) is the centre of the upper-left pixel, as ours.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.products import Camera, Georeference, Photograph, Survey

Fields = list[str]

CAMERAS_HEADER = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"
IMAGES_HEADER = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]"
POINTS_HEADER = "POINT3D_ID X Y Z R G B ERROR TRACK[]"

# Models by name, each with how its parameters make (fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6).
PARAMETERS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2),
    "PINHOLE": (0, 1, 2, 3),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3),
    "RADIAL": (0, 0, 1, 2, 3, 4),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
    "FULL_OPENCV": (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11),
}


def write_colmap_text(survey: Survey, folder: Path) -> None:
    """Write the survey as a COLMAP text model; points carry no tracks, because a survey keeps none.

    Images are named by their paths below the folder that holds them all, to be given as COLMAP's image path.

    Raises:
        InputError: an image's name holds a space, at which COLMAP would cut it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    common = common_folder(survey)
    images = (
        (photograph.path.relative_to(common).as_posix(), pose, photograph.camera + 1)
        for photograph, pose in zip(survey.photographs, survey.world_from_camera, strict=True)
    )
    _write(folder / "cameras.txt", CAMERAS_HEADER, _camera_lines(survey.cameras))
    _write(folder / "images.txt", IMAGES_HEADER, _image_lines(images))
    _write(folder / "points3D.txt", POINTS_HEADER, _point_lines(survey))


def write_colmap_views(views: Sequence[PosedCamera], folder: Path) -> None:
    """Write views as a COLMAP text model without points, one camera for each lens.

    Raises:
        InputError: a view's name holds a space, at which COLMAP would cut it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = list(dict.fromkeys(view.camera for view in views))
    numbers = {camera: number for number, camera in enumerate(cameras, 1)}
    images = ((view.name, view.world_from_camera, numbers[view.camera]) for view in views)
    _write(folder / "cameras.txt", CAMERAS_HEADER, _camera_lines(cameras))
    _write(folder / "images.txt", IMAGES_HEADER, _image_lines(images))
    _write(folder / "points3D.txt", POINTS_HEADER, iter(()))


def read_colmap_views(folder: Path) -> list[PosedCamera]:
    """Read where the images of a COLMAP text model were taken, in the order of their numbers; points are left alone.

    Raises:
        InputError: a file is missing, a line can't be read, or a lens model has no counterpart.
    """
    cameras = {int(fields[0]): _camera(fields, folder) for fields in _lines(folder / "cameras.txt", 5)}
    images = sorted(_lines(folder / "images.txt", 10, every=2), key=lambda fields: int(fields[0]))
    return [PosedCamera(fields[9], cameras[int(fields[8])], _world_from_camera(fields)) for fields in images]


def read_colmap_model(folder: Path) -> PosedModel:
    """Read a COLMAP text model in its own frame, images and points in the order of their numbers.

    Raises:
        InputError: a file is missing, a line can't be read, or a lens model has no counterpart.
    """
    numbers = _point_numbers(folder)
    return PosedModel(
        views=tuple(read_colmap_views(folder)),
        points=numbers[:, :3],
        colors=numbers[:, 3:6].astype(np.uint8),
        errors=numbers[:, 6],
    )


def read_colmap_text(folder: Path, photographs: Path, georeference: Georeference) -> Survey:
    """Read a COLMAP text model whose world is the local frame of `georeference`; its images lie in `photographs`.

    Position sigmas, which COLMAP doesn't keep, read as 0.

    Raises:
        InputError: a file or image is missing, a line can't be read, or a lens model has no counterpart.
    """
    cameras = {int(fields[0]): _camera(fields, folder) for fields in _lines(folder / "cameras.txt", 5)}
    camera_ids = sorted(cameras)
    images = sorted(_lines(folder / "images.txt", 10, every=2), key=lambda fields: int(fields[0]))
    numbers = _point_numbers(folder)
    return Survey(
        georeference=georeference,
        cameras=tuple(cameras[camera_id] for camera_id in camera_ids),
        photographs=tuple(_photograph(fields, photographs, camera_ids) for fields in images),
        world_from_camera=np.array([_world_from_camera(fields) for fields in images]).reshape(-1, 3, 4),
        position_sigma=np.zeros((len(images), 3)),
        sparse_points=numbers[:, :3].astype(np.float32),
        sparse_colors=numbers[:, 3:6].astype(np.uint8),
        sparse_errors=numbers[:, 6].astype(np.float32),
    )


def parameters_of_camera(camera: Camera) -> tuple[str, list[float]]:
    """Return the simplest lens model that holds a camera exactly, and its parameters."""
    k1, k2, p1, p2, k3 = camera.distortion
    values = [camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y]
    if k3:
        return "FULL_OPENCV", [*values, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    return ("OPENCV", [*values, k1, k2, p1, p2]) if any(camera.distortion) else ("PINHOLE", values)


def camera_of_parameters(model: str, width: int, height: int, values: Sequence[float], where: str) -> Camera:
    """Return the camera of a lens model's parameters.

    Raises:
        InputError: the model is unknown, has other parameters, or has no counterpart.
    """
    if model not in PARAMETERS or len(values) != max(PARAMETERS[model]) + 1:
        raise InputError(
            f"the lens model '{model}' with {len(values)} parameters can't be read",
            where=where,
            cure=f"use one of {', '.join(PARAMETERS)}",
        )
    fx, fy, cx, cy, *distortion = (values[place] for place in PARAMETERS[model])
    k1, k2, p1, p2, k3, *rational = [*distortion, *[0.0] * (5 - len(distortion))]
    if any(rational):
        raise InputError(
            "the lens has rational coefficients k4 to k6, which the survey's cameras don't",
            where=where,
            cure="adjust it as OPENCV, or undistort the images",
        )
    return Camera(
        width=width,
        height=height,
        focal_x=fx,
        focal_y=fy,
        principal_x=cx,
        principal_y=cy,
        distortion=(k1, k2, p1, p2, k3),
    )


def world_from_camera_of(numbers: Float64Array) -> Float64Array:
    """Return world from camera (3, 4) of COLMAP's quaternion (w, x, y, z) and translation, seven numbers."""
    rotation = rotation_of(numbers[:4])
    return np.column_stack([rotation.T, -rotation.T @ numbers[4:]])


def common_folder(survey: Survey) -> Path:
    """Return the deepest folder that holds every photograph."""
    parents = [set(photograph.path.parents) for photograph in survey.photographs]
    return max(set.intersection(*parents), key=lambda folder: len(folder.parts)) if parents else Path()


def quaternion_of(rotation: Float64Array) -> Float64Array:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a (3, 3) rotation.

    It is the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix (2000, J. Guidance 23(6)),
    which needs no case for any angle.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation.ravel()
    symmetric = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, yx + xy, zx + xz],
            [xz - zx, yx + xy, yy - xx - zz, zy + yz],
            [yx - xy, zx + xz, zy + yz, zz - xx - yy],
        ]
    )
    quaternion: Float64Array = np.linalg.eigh(symmetric)[1][:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion


def rotation_of(quaternion: Float64Array) -> Float64Array:
    """Return the (3, 3) rotation of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _camera_lines(cameras: Sequence[Camera]) -> Iterator[str]:
    """Yield the simplest model that holds each camera exactly; floats are written so that they read back the same."""
    for number, camera in enumerate(cameras, 1):
        model, values = parameters_of_camera(camera)
        yield f"{number} {model} {camera.width} {camera.height} {_join(values)}"


def _image_lines(images: Iterable[tuple[str, Float64Array, int]]) -> Iterator[str]:
    """Yield two lines per image (name, world_from_camera, number of its camera), the second one empty."""
    for number, (name, pose, camera) in enumerate(images, 1):
        quaternion = quaternion_of(pose[:, :3].T)
        translation = -pose[:, :3].T @ pose[:, 3]
        if any(character.isspace() for character in name):
            raise InputError(
                f"COLMAP's text model can't name '{name}': it cuts names at spaces",
                where=name,
                cure="rename the photograph and run again",
            )
        yield f"{number} {_join([*quaternion, *translation])} {camera} {name}\n"


def _point_lines(survey: Survey) -> Iterator[str]:
    rows = zip(survey.sparse_points, survey.sparse_colors, survey.sparse_errors, strict=True)
    for number, (place, color, error) in enumerate(rows, 1):
        yield f"{number} {_join(place)} {color[0]} {color[1]} {color[2]} {float(error)!r}"


def _join(values: list[float] | Float64Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def _write(path: Path, header: str, lines: Iterator[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"# {header}\n")
        file.writelines(f"{line}\n" for line in lines)


def _lines(path: Path, least: int, *, every: int = 1) -> Iterator[Fields]:
    """Yield the fields of every first, or every second, line that isn't a comment; names may hold spaces.

    Raises:
        InputError: the file is missing, or a line has fewer than `least` fields.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError("the COLMAP model is incomplete", where=str(path), cure="export it as text") from error
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    for row in rows[::every]:
        fields = row.split(maxsplit=9) if every == 2 else row.split()
        if every == 1 and not fields:
            continue
        if len(fields) < least:
            raise InputError(
                f"a line of the COLMAP model has {len(fields)} fields, not {least}: '{row}'",
                where=str(path),
                cure="export the model again, as text",
            )
        yield fields


def _camera(fields: Fields, folder: Path) -> Camera:
    values = [float(field) for field in fields[4:]]
    return camera_of_parameters(fields[1], int(fields[2]), int(fields[3]), values, str(folder / "cameras.txt"))


def _photograph(fields: Fields, photographs: Path, camera_ids: list[int]) -> Photograph:
    path = photographs / fields[9]
    if not path.is_file():
        raise InputError(
            f"the COLMAP model's image '{fields[9]}' is missing", where=str(path), cure="give the folder of its images"
        )
    return Photograph(
        path=path, camera=camera_ids.index(int(fields[8])), sha256=hashlib.sha256(path.read_bytes()).hexdigest()
    )


def _world_from_camera(fields: Fields) -> Float64Array:
    return world_from_camera_of(np.array([float(field) for field in fields[1:8]]))


def _point_numbers(folder: Path) -> Float64Array:
    """Return place, colour and error (point, 7), in the order of the points' numbers."""
    points = sorted(_lines(folder / "points3D.txt", 8), key=lambda fields: int(fields[0]))
    return np.array([[float(field) for field in fields[1:8]] for fields in points], np.float64).reshape(-1, 7)
