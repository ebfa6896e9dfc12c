"""The survey as its metadata alone places it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.geodesy import enu_from_geodetic, mean_origin
from slideframe.masks import find_masks, mask_files
from slideframe.products import Camera, Georeference
from slideframe.stages import Context
from slideframe.store import digest_file
from slideframe_pose_rtk.features import PictureFile
from slideframe_pose_rtk.intrinsics import Calibration, camera_of
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.naming import names
from slideframe_pose_rtk.orientation import world_from_camera

Poses = dict[int, Float64Array]  # world from camera (3, 4) by photograph


@dataclass(frozen=True, eq=False)
class Flight:
    """Photographs in file order, with poses from metadata in the local frame.

    Attributes:
        folder: where the files lie.
        records: one per photograph.
        georeference: origin of the local frame.
        cameras: distinct cameras.
        calibrations: how each camera's focal length is known.
        camera_of: index into `cameras` per photograph.
        positions: (photograph, 3), m.
        position_sigma: (photograph, 3), m.
        rotations: (photograph, 3, 3) world from camera; the identity where not `oriented`.
        oriented: (photograph,), whether the gimbal angles are known.
    """

    folder: Path
    records: tuple[PhotoRecord, ...]
    georeference: Georeference
    cameras: tuple[Camera, ...]
    calibrations: tuple[Calibration, ...]
    camera_of: tuple[int, ...]
    positions: Float64Array
    position_sigma: Float64Array
    rotations: Float64Array
    oriented: np.ndarray

    def __len__(self) -> int:
        return len(self.records)

    def name(self, index: int) -> str:
        """Return the file's path below the folder, which is unique."""
        return self.records[index].path.relative_to(self.folder).as_posix()


def plan_flight(records: Sequence[PhotoRecord], folder: Path, origin: Georeference | None, context: Context) -> Flight:
    """Place the photographs by their metadata, warning of what it leaves open."""
    geodetic = np.array([(record.latitude, record.longitude, record.height) for record in records], np.float64)
    georeference = origin or mean_origin(geodetic)
    cameras, calibrations, camera_indices = _distinct_cameras(records)
    oriented = np.array([record.gimbal is not None and not record.has_zero_gimbal for record in records])
    flight = Flight(
        folder=folder,
        records=tuple(records),
        georeference=georeference,
        cameras=cameras,
        calibrations=calibrations,
        camera_of=camera_indices,
        positions=enu_from_geodetic(geodetic, georeference),
        position_sigma=np.array([record.position_sigma for record in records]),
        rotations=np.array(
            [
                world_from_camera(*record.gimbal) if known and record.gimbal else np.eye(3)
                for record, known in zip(records, oriented, strict=True)
            ]
        ),
        oriented=oriented,
    )
    _warn_of_gaps(flight, context)
    return flight


def picture_files(flight: Flight, digests: Sequence[str], masks: Path | None) -> list[PictureFile]:
    """Return the photographs' files with their digests and the masks of that folder.

    Raises:
        InputError: the folder has no masks for them.
    """
    paths = [record.path for record in flight.records]
    found = find_masks(paths, mask_files(masks)) if masks else {}
    return [
        PictureFile(path, sha256, found.get(path), digest_file(found[path]) if path in found else "")
        for path, sha256 in zip(paths, digests, strict=True)
    ]


def _distinct_cameras(
    records: Sequence[PhotoRecord],
) -> tuple[tuple[Camera, ...], tuple[Calibration, ...], tuple[int, ...]]:
    """Number the cameras in order of appearance; photographs of equal size and calibration share one."""
    known: dict[tuple[str, Camera], int] = {}
    calibrations: list[Calibration] = []
    indices = []
    for record in records:
        camera, calibration = camera_of(record)
        key = (record.model, camera)
        if key not in known:
            known[key] = len(known)
            calibrations.append(calibration)
        indices.append(known[key])
    return tuple(camera for _, camera in known), tuple(calibrations), tuple(indices)


def _warn_of_gaps(flight: Flight, context: Context) -> None:
    records = flight.records
    count = len(records)
    weak = [record for record in records if record.fix != "fixed"]
    if weak:
        context.warn(f"{len(weak)} of {count} photographs have no fixed RTK position: {names(weak)}")
    lost = [record for record, known in zip(records, flight.oriented, strict=True) if not known]
    if lost:
        context.warn(f"{len(lost)} of {count} photographs hold no gimbal angles, or zeros: {names(lost)}")
    if "nominal" in flight.calibrations:
        context.warn("the focal length is EXIF's 35 mm equivalent, good to some percent, and heights with it")


def require_orientations(flight: Flight, least: int) -> None:
    """Refuse a survey that metadata can't start.

    Raises:
        InputError: fewer than `least` photographs have gimbal angles.
    """
    known = int(flight.oriented.sum())
    if known < least:
        raise InputError(
            f"at least {least} photographs with gimbal angles are needed, and {known} of {len(flight)} have them",
            where=str(flight.folder),
            cure="use the files as the drone wrote them: editing programs often remove the XMP metadata",
        )
