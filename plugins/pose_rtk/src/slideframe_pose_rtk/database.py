"""COLMAP's database of a survey's features and matches, from which it triangulates."""

from pathlib import Path
from typing import TYPE_CHECKING

from slideframe_pose_rtk.features import Features
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.matching import Matches

if TYPE_CHECKING:
    import pycolmap


def write_database(
    path: Path, flight: Flight, lenses: "list[pycolmap.Camera]", features: list[Features], matches: Matches
) -> None:
    """Write a new database, in which photograph `i` is image, frame and pose `i + 1`."""
    import pycolmap

    path.unlink(missing_ok=True)
    database = pycolmap.Database.open(path)
    try:
        with pycolmap.DatabaseTransaction(database):
            for lens in lenses:
                database.write_camera(lens, use_camera_id=True)
                database.write_rig(rig_of(lens), use_rig_id=True)
            for index in range(len(flight)):
                image, frame = image_and_frame(flight, index)
                database.write_image(image, use_image_id=True)
                database.write_frame(frame, use_frame_id=True)
                if len(features[index].keypoints):
                    database.write_keypoints(index + 1, features[index].keypoints)
            for (first, second), pair in sorted(matches.items()):
                geometry = pycolmap.TwoViewGeometry(
                    config=int(pycolmap.TwoViewGeometryConfiguration.CALIBRATED), inlier_matches=pair
                )
                database.write_two_view_geometry(first + 1, second + 1, geometry)
    finally:
        database.close()


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
