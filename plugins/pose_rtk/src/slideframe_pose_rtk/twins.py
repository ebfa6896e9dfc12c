"""Photographs that are one exposure saved twice, in files that differ."""

from collections.abc import Hashable, Sequence

from slideframe.stages import Context
from slideframe_pose_rtk.metadata import PhotoRecord


def without_twins(records: Sequence[PhotoRecord], context: Context) -> list[PhotoRecord]:
    """Leave out copies that a program reduced or compressed again, warning by name; the largest picture stays.

    A prior counted twice would weigh twice, and a pair without a base line shows no depth. Exposures are
    told apart by camera, time, exposure time, place and angles; without a time nothing is left out.
    """
    best: dict[Hashable, PhotoRecord] = {}
    for record in records:
        key = _exposure(record)
        if key not in best or record.size > best[key].size:
            best[key] = record
    left_out = [record for record in records if best[_exposure(record)] is not record]
    for record in left_out:
        context.warn(
            f"{record.path.name} is left out: it's the same exposure as {best[_exposure(record)].path.name},"
            " saved once more"
        )
    return [record for record in records if best[_exposure(record)] is record]


def _exposure(record: PhotoRecord) -> Hashable:
    time = record.utc or record.local_time
    if time is None:
        return record.path
    camera = record.make, record.model, record.serial, record.image_source, record.focal_length
    return camera, time, record.exposure_time, record.latitude, record.longitude, record.height, record.gimbal
