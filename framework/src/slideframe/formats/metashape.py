"""Agisoft Metashape's cameras.xml (File > Export > Export Cameras, format Agisoft XML).

A camera's transform carries camera axes (x right, y down, z forward) to the chunk's, the chunk's transform on to
earth-centred coordinates where the chunk is georeferenced. The calibration is that of the Metashape manual's
appendix "Camera models": radial terms as OpenCV's, P1 and P2 in the other order, cx and cy from the picture's middle.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.geodesy import SEMI_MAJOR_AXIS, enu_axes, geodetic_from_ecef
from slideframe.products import Camera, Georeference

# A chunk's origin within 1 % of the Earth's radius is earth-centred; a local frame's is a few kilometres at most.
EARTH_MARGIN = 0.01
# px over the picture's height; a shear that moves a pixel at the rim by less is neglected, and stated.
NEGLECTED_SHEAR = 2.0


def read_metashape(path: Path) -> PosedModel:
    """Read the first chunk with aligned cameras; cameras that Metashape couldn't align are left out.

    Raises:
        InputError: the file is missing or no such file, no camera is aligned, or a lens has no counterpart.
    """
    chunk = _chunk(path)
    remarks: list[str] = []
    try:
        lenses = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
        whole = _similarity(chunk.find("transform")) or (1.0, np.eye(3), np.zeros(3))
        parts = {part.get("id"): _similarity(part.find("transform")) for part in chunk.iter("component")}
        poses, cameras, names = [], [], []
        for camera in _aligned(chunk):
            poses.append(_pose(camera, parts.get(camera.get("component_id")) or whole))
            cameras.append(_camera(lenses[camera.get("sensor_id")], path, remarks))
            names.append(str(camera.get("label")))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"this is no cameras.xml of Metashape: {error!r}", where=str(path), cure="export the cameras again"
        ) from error
    georeference, local = _localized(np.array(poses))
    return PosedModel(
        views=tuple(PosedCamera(*view) for view in zip(names, cameras, local, strict=True)),
        georeference=georeference,
        remarks=tuple(dict.fromkeys(remarks)),
    )


def _chunk(path: Path) -> Element:
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(f"the model can't be read: {error.strerror}", where=str(path), cure="name the file") from error
    try:
        if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
            raise ValueError("it defines entities, which Metashape never does")
        chunks = list(ElementTree.fromstring(text).iter("chunk"))
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"this is no XML: {error}", where=str(path), cure="export the cameras again") from error
    for chunk in chunks:
        if any(True for _ in _aligned(chunk)):
            return chunk
    raise InputError("no camera of the file is aligned", where=str(path), cure="align the photographs first")


def _aligned(chunk: Element) -> Iterator[Element]:
    return (camera for camera in chunk.iter("camera") if camera.find("transform") is not None)


def _similarity(element: Element | None) -> tuple[float, Float64Array, Float64Array] | None:
    """Return scale, rotation and translation, or None where there is no transform."""
    if element is None or element.find("rotation") is None:
        return None
    scale = element.findtext("scale")
    rotation = _numbers(element.findtext("rotation"), 9).reshape(3, 3)
    return float(scale) if scale else 1.0, rotation, _numbers(element.findtext("translation"), 3)


def _pose(camera: Element, to_world: tuple[float, Float64Array, Float64Array]) -> Float64Array:
    scale, rotation, translation = to_world
    matrix = _numbers(camera.findtext("transform"), 16).reshape(4, 4)
    return np.column_stack([rotation @ matrix[:3, :3], scale * rotation @ matrix[:3, 3] + translation])


def _localized(poses: Float64Array) -> tuple[Georeference | None, Float64Array]:
    """Return the poses east, north, up of their mean place where they are earth-centred, else as they are."""
    middle = poses[:, :, 3].mean(axis=0)
    if abs(np.linalg.norm(middle) / SEMI_MAJOR_AXIS - 1) > EARTH_MARGIN:
        return None, poses
    latitude, longitude, height = (float(value) for value in geodetic_from_ecef(middle[None])[0])
    origin = Georeference(latitude=latitude, longitude=longitude, ellipsoidal_height=height)
    axes = enu_axes(origin)
    local = np.concatenate([axes @ poses[:, :, :3], ((poses[:, :, 3] - middle) @ axes.T)[:, :, None]], axis=2)
    return origin, local


def _camera(sensor: Element, path: Path, remarks: list[str]) -> Camera:
    kind = sensor.get("type", "frame")
    adjusted = [lens for lens in sensor.iter("calibration") if lens.get("class") == "adjusted"]
    lens = (adjusted or list(sensor.iter("calibration")))[0]
    values = {item.tag: float(item.text) for item in lens if item.tag != "resolution" and item.text}
    if kind != "frame" or values.get("k4") or abs(values.get("b2", 0.0)) > NEGLECTED_SHEAR:
        raise InputError(
            f"the lens '{sensor.get('label')}' of type '{kind}' with k4 = {values.get('k4', 0):g} and"
            f" b2 = {values.get('b2', 0):g} can't be read",
            where=str(path),
            cure="optimise the cameras without k4 and b2 (frame cameras only), or undistort the images",
        )
    if values.get("b2"):
        remarks.append(f"the shear b2 = {values['b2']:g} px of '{sensor.get('label')}' is neglected")
    k1, k2, p1, p2, k3 = (values.get(name, 0.0) for name in ("k1", "k2", "p2", "p1", "k3"))
    resolution = lens.find("resolution") if lens.find("resolution") is not None else sensor.find("resolution")
    assert resolution is not None
    width, height = int(resolution.get("width", 0)), int(resolution.get("height", 0))
    return Camera(
        width=width,
        height=height,
        focal_x=values["f"] + values.get("b1", 0.0),
        focal_y=values["f"],
        principal_x=width / 2 + values.get("cx", 0.0),
        principal_y=height / 2 + values.get("cy", 0.0),
        distortion=(k1, k2, p1, p2, k3),
    )


def _numbers(text: str | None, count: int) -> Float64Array:
    values = np.array([float(word) for word in (text or "").split()], np.float64)
    if len(values) != count:
        raise ValueError(f"{len(values)} numbers where {count} belong")
    return values
