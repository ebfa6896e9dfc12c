"""Masks: which pixels of a photograph are to be used, as pictures of the same name in a folder of their own.

Black (below half brightness) pixels are left out: the sky, the drone's own shadow, traffic, people.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from slideframe.errors import InputError

Mask = npt.NDArray[np.bool_]

# Programs append these to the photograph's name: Metashape and ODM, COLMAP (after the extension), and plain names.
ENDINGS = ("_mask.png", "_mask.jpg", "_mask.jpeg", ".png", ".jpg", ".jpeg")
HALF = 128


def mask_files(folder: Path) -> list[Path]:
    """Return every mask under a folder.

    Raises:
        InputError: the folder is missing or holds none.
    """
    found = [path for path in folder.rglob("*") if path.suffix.lower() in (".png", ".jpg", ".jpeg")]
    if not found:
        raise InputError(
            "the folder of masks holds no pictures" if folder.is_dir() else "the folder of masks doesn't exist",
            where=str(folder),
            cure="name the folder of masks, pictures named like the photographs: DJI_0001.png or DJI_0001_mask.png",
        )
    return sorted(found)


def find_masks(photographs: list[Path], masks: list[Path]) -> dict[Path, Path]:
    """Return the mask of each photograph that has one, by name, whatever the case of letters.

    Raises:
        InputError: two masks are named like one photograph, or none like any.
    """
    by_name: dict[str, list[Path]] = {}
    for mask in masks:
        by_name.setdefault(mask.name.lower(), []).append(mask)
    found = {}
    for photograph in photographs:
        stems = (photograph.stem.lower(), photograph.name.lower())
        candidates = [mask for stem in stems for ending in ENDINGS for mask in by_name.get(stem + ending, [])]
        if len(candidates) > 1:
            raise InputError(
                f"two masks are named like {photograph.name}: {candidates[0].name} and {candidates[1].name}",
                where=str(candidates[1]),
                cure="keep one of them",
            )
        if candidates:
            found[photograph] = candidates[0]
    if masks and not found:
        raise InputError(
            f"no mask is named like a photograph; the first is {masks[0].name}",
            where=str(masks[0].parent),
            cure="name masks like the photographs: DJI_0001.png or DJI_0001_mask.png",
        )
    return found


def read_mask(path: Path, width: int, height: int) -> Mask:
    """Return (height, width), true where pixels are to be used; a mask of another size is scaled to the photograph's.

    Raises:
        InputError: it can't be read, or has another shape.
    """
    try:
        with Image.open(path) as file:
            picture = file.convert("L")
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"a mask can't be read: {error}", where=str(path), cure="write it again") from error
    if abs(picture.width * height - picture.height * width) > max(width, height):
        raise InputError(
            f"a mask is {picture.width}x{picture.height} px, of another shape than its photograph of {width}x{height}",
            where=str(path),
            cure="draw it over the photograph as the drone wrote it",
        )
    return np.asarray(picture.resize((width, height), Image.Resampling.NEAREST)) >= HALF
