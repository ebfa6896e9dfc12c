"""SIFT features of every photograph, each kept under its content, so that they are found once and never again."""

import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PIL import Image

from slideframe.arrays import Float32Array, UInt8Array
from slideframe.errors import InputError
from slideframe.masks import read_mask
from slideframe.quality.pictures import PictureQuality, inspect_picture
from slideframe.stages import Context
from slideframe.store import digest, storing

if TYPE_CHECKING:
    import pycolmap

FORMAT = 1  # raised whenever what follows finds other features for the same options


@dataclass(frozen=True, eq=False)
class Features:
    """What one photograph shows.

    Attributes:
        key: digest of all that decides the rest: the file's bytes and the options.
        keypoints: (feature, 4) column, row, scale, px of the full picture, and orientation, rad.
        descriptors: (feature, 128).
        quality: of the picture; None where it can't be decoded.
    """

    key: str
    keypoints: Float32Array
    descriptors: UInt8Array
    quality: PictureQuality | None


@dataclass(frozen=True)
class FeatureOptions:
    """What decides the features of given pixels."""

    feature_limit: int
    size_limit: int

    def key_of(self, picture: "PictureFile") -> str:
        """Return the key of a picture's features."""
        options = [self.feature_limit, self.size_limit]
        return digest(["features", FORMAT, version("pycolmap"), options, picture.sha256, picture.mask_sha256])


@dataclass(frozen=True)
class PictureFile:
    """A photograph and its mask, with the digests of their bytes."""

    path: Path
    sha256: str
    mask: Path | None = None
    mask_sha256: str = ""


def find_features(
    pictures: Sequence[PictureFile], options: FeatureOptions, shelf: Path, context: Context
) -> list[Features]:
    """Return the features of every photograph, from the shelf where they lie there; none where it can't be decoded."""
    extractor = None
    found = []
    for index, picture in enumerate(pictures):
        context.progress(index, len(pictures))
        path, key = picture.path, options.key_of(picture)
        known = read_array_file(shelf / f"{key}.npz")
        if known is None:
            extractor = extractor or _extractor(options)
            try:
                known = _extract(extractor, picture, options)
            except InputError as error:
                context.warn(f"{path.name}: {error.what}")
                found.append(Features(key, np.empty((0, 4), np.float32), np.empty((0, 128), np.uint8), None))
                continue
            write_array_file(shelf / f"{key}.npz", known)
        quality = PictureQuality(*(float(value) for value in known["quality"]))
        found.append(Features(key, known["keypoints"], known["descriptors"], quality))
    return found


def inspect_pictures(paths: list[Path], context: Context) -> list[PictureQuality | None]:
    """Return the quality of every picture, None for one that can't be decoded."""
    qualities: list[PictureQuality | None] = []
    for index, path in enumerate(paths):
        context.progress(index, len(paths))
        try:
            qualities.append(inspect_picture(_gray(path)))
        except InputError as error:
            context.warn(f"{path.name}: {error.what}")
            qualities.append(None)
    return qualities


def read_array_file(path: Path) -> dict[str, npt.NDArray[np.generic]] | None:
    """Return the arrays of an .npz file, or None where it is absent or damaged."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None


def write_array_file(path: Path, arrays: dict[str, npt.NDArray[np.generic]]) -> None:
    """Write an .npz file, whole or not at all, even where two runs write the same one."""
    with storing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.npz")
        np.savez(partial, **arrays)  # type: ignore[arg-type]
        partial.replace(path)


def _extractor(options: FeatureOptions) -> "pycolmap.FeatureExtractor":
    import pycolmap

    settings = pycolmap.FeatureExtractionOptions()
    settings.use_gpu = False
    settings.num_threads = 1
    settings.sift.max_num_features = options.feature_limit
    settings.sift.first_octave = 0  # doubling the picture costs five times the time and finds few better features
    settings.sift.max_num_orientations = 1
    return pycolmap.FeatureExtractor.create(settings, pycolmap.Device.cpu)


def _extract(
    extractor: "pycolmap.FeatureExtractor", file: PictureFile, options: FeatureOptions
) -> dict[str, npt.NDArray[np.generic]]:
    """Return keypoints and descriptors where the mask leaves them, and the picture's sharpness and contrast.

    Raises:
        InputError: the pixels or the mask can't be decoded.
    """
    import pycolmap

    picture = _gray(file.path)
    used = read_mask(file.mask, *picture.size) if file.mask else None
    quality = inspect_picture(picture)
    full = np.array(picture.size, np.float64)
    picture.thumbnail((options.size_limit, options.size_limit), Image.Resampling.LANCZOS)
    scale = full / picture.size
    keypoints, descriptors = extractor.extract_from_uint8_array(np.asarray(picture))
    matrix = np.array(pycolmap.keypoints_to_matrix(keypoints), np.float32)
    matrix[:, :2] *= scale
    matrix[:, 2] *= scale[0]
    kept = slice(None) if used is None else used[matrix[:, 1].astype(int), matrix[:, 0].astype(int)]
    return {
        "keypoints": matrix[kept],
        "descriptors": np.array(descriptors.data, np.uint8)[kept],
        "quality": np.array([quality.sharpness, quality.contrast]),
    }


def _gray(path: Path) -> Image.Image:
    """Return the brightness of the stored pixels, not turned by EXIF's orientation.

    Raises:
        InputError: they can't be decoded.
    """
    try:
        with Image.open(path) as picture:
            return picture.convert("L")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(
            f"its pixels can't be decoded ({error})", where=str(path), cure="copy it from the drone again"
        ) from error
