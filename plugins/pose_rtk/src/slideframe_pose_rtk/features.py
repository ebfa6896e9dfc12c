"""SIFT features of every photograph, kept in a COLMAP database, so that a resumed run goes on where it stopped."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from slideframe.errors import InputError
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight

if TYPE_CHECKING:
    import pycolmap


def open_database(path: Path, flight: Flight, lenses: "list[pycolmap.Camera]") -> "pycolmap.Database":
    """Open or create the database, in which photograph `i` is image, frame and pose `i + 1`."""
    import pycolmap

    database = pycolmap.Database.open(path)
    if database.num_images() == len(flight):
        return database
    database.clear_all_tables()
    with pycolmap.DatabaseTransaction(database):
        for lens in lenses:
            database.write_camera(lens, use_camera_id=True)
            database.write_rig(rig_of(lens), use_rig_id=True)
        for index in range(len(flight)):
            image, frame = image_and_frame(flight, index)
            database.write_image(image, use_image_id=True)
            database.write_frame(frame, use_frame_id=True)
    return database


def rig_of(lens: "pycolmap.Camera") -> "pycolmap.Rig":
    """Return the rig that holds one camera alone."""
    import pycolmap

    rig = pycolmap.Rig(rig_id=lens.camera_id)
    rig.add_ref_sensor(lens.sensor_id)
    return rig


def image_and_frame(flight: Flight, index: int) -> "tuple[pycolmap.Image, pycolmap.Frame]":
    """Return COLMAP's image and frame of photograph `index`."""
    import pycolmap

    camera_id = flight.camera_of[index] + 1
    image = pycolmap.Image(name=flight.name(index), camera_id=camera_id, image_id=index + 1)
    frame = pycolmap.Frame(frame_id=index + 1, rig_id=camera_id)
    frame.add_data_id(image.data_id)
    return image, frame


def extract_features(
    database: "pycolmap.Database", flight: Flight, feature_limit: int, size_limit: int, context: Context
) -> None:
    """Find features in every photograph that the database has none of; one that can't be decoded is left without."""
    import pycolmap

    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = 1
    options.sift.max_num_features = feature_limit
    options.sift.first_octave = 0  # doubling the picture costs five times the time and finds few better features
    options.sift.max_num_orientations = 1
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    for index in range(len(flight)):
        context.progress(index, len(flight))
        if database.exists_keypoints(index + 1) and database.exists_descriptors(index + 1):
            continue
        try:
            pixels, scale = _gray(flight.records[index].path, size_limit)
        except InputError as error:
            context.warn(f"{flight.name(index)}: {error.what}")
            continue
        keypoints, descriptors = extractor.extract_from_uint8_array(pixels)
        matrix = np.array(pycolmap.keypoints_to_matrix(keypoints), np.float32)
        matrix[:, :2] *= scale
        matrix[:, 2] *= scale[0]
        with pycolmap.DatabaseTransaction(database):
            database.write_keypoints(index + 1, matrix)
            database.write_descriptors(index + 1, descriptors)


def _gray(path: Path, size_limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness (row, column) of the stored pixels, not turned by EXIF's orientation, at most `size_limit`
    wide or high, and the factors (x, y) back to stored pixels.

    Raises:
        InputError: the pixels can't be decoded.
    """
    try:
        with Image.open(path) as picture:
            gray = picture.convert("L")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(
            f"its pixels can't be decoded ({error})", where=str(path), cure="copy it from the drone again"
        ) from error
    full = np.array(gray.size, np.float64)
    gray.thumbnail((size_limit, size_limit), Image.Resampling.LANCZOS)
    return np.asarray(gray), full / gray.size
