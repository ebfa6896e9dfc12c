"""Other programs' camera models, told apart by their files."""

from collections.abc import Callable, Sequence
from pathlib import Path

from slideframe.errors import InputError
from slideframe.formats.colmap import read_colmap_model
from slideframe.formats.colmap_binary import read_colmap_binary
from slideframe.formats.metashape import read_metashape
from slideframe.formats.opensfm import REFERENCE, TOPOCENTRIC, read_opensfm
from slideframe.formats.posed_model import PosedModel
from slideframe.formats.transforms_json import read_transforms_json

# Where programs leave their models below the folder that people name: COLMAP's workspaces, ODM's projects.
FOLDERS = (".", "sparse/0", "sparse", "0", "opensfm", "cameras")
# The files of each format, the first of which tells it.
COLMAP_BINARY = ("cameras.bin", "images.bin", "points3D.bin")
COLMAP_TEXT = ("cameras.txt", "images.txt", "points3D.txt")
OPENSFM = ("reconstruction.json", TOPOCENTRIC, REFERENCE)
NERFSTUDIO = ("transforms.json",)
METASHAPE = ("cameras.xml",)


def read_posed_model(path: Path) -> PosedModel:
    """Read a COLMAP model (binary or text), OpenSfM's or ODM's, a transforms.json, or Metashape's cameras.xml.

    `path` is the file, the model's folder, or the program's project folder.

    Raises:
        InputError: there is no such model, or it can't be read.
    """
    files, reader = _found(path)
    return reader(files[0])


def posed_model_files(path: Path) -> list[Path]:
    """Return every file that `read_posed_model` reads.

    Raises:
        InputError: there is no model.
    """
    return _found(path)[0]


def _found(path: Path) -> tuple[list[Path], Callable[[Path], PosedModel]]:
    readers: tuple[tuple[Sequence[str], Callable[[Path], PosedModel]], ...] = (
        (COLMAP_BINARY, lambda first: read_colmap_binary(first.parent)),
        (COLMAP_TEXT, lambda first: read_colmap_model(first.parent)),
        (OPENSFM, read_opensfm),
        (NERFSTUDIO, _read_nerfstudio),
        (METASHAPE, read_metashape),
    )
    if path.suffix == ".xml":
        return [path], read_metashape
    if path.suffix == ".json" and path.name not in OPENSFM:
        return [path], _read_nerfstudio
    folders = [path / name for name in FOLDERS] if path.is_dir() else [path.parent]
    for folder in folders:
        for names, reader in readers:
            if (folder / names[0]).is_file() and (path.is_dir() or path.name in names):
                return [folder / name for name in names if (folder / name).is_file()], reader
    raise InputError(
        "there is no camera model" if path.exists() else "the camera model doesn't exist",
        where=str(path),
        cure="name a COLMAP model, OpenSfM's reconstruction.json, a transforms.json or Metashape's cameras.xml,"
        " or the folder that holds it",
    )


def _read_nerfstudio(path: Path) -> PosedModel:
    return PosedModel(views=tuple(read_transforms_json(path)))
