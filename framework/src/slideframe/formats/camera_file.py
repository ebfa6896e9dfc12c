"""Cameras of another program, whatever form they come in."""

from pathlib import Path

from slideframe.errors import InputError
from slideframe.formats.colmap import read_colmap_views
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.transforms_json import read_transforms_json


def read_views(path: Path) -> list[PosedCamera]:
    """Read the views of a COLMAP model's folder or of a `transforms.json`.

    Raises:
        InputError: it is neither, or damaged.
    """
    if path.is_dir():
        return read_colmap_views(path)
    if path.suffix.lower() == ".json":
        return read_transforms_json(path)
    raise InputError(
        "cameras are read from a COLMAP model's folder or a transforms.json", where=str(path), cure="name one of these"
    )
