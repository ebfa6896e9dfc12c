"""Which photograph each view of an imported model is, and what the model knows of photographs that know nothing."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.geodesy import geodetic_from_enu
from slideframe_pose_rtk.intrinsics import camera_of
from slideframe_pose_rtk.metadata import PhotoRecord


def views_by_photograph(names: Sequence[str], views: Sequence[PosedCamera]) -> dict[int, PosedCamera]:
    """Find each view's photograph by path, else by file name, else by name without extension, where it's the only one.

    `names` are the photographs' paths below their folder; the result's keys are indices into them.
    """
    indices = {name: index for index, name in enumerate(names)}
    found = {}
    for view in views:
        index = _match(view.name, indices)
        if index is not None:
            found[index] = view
    return found


def filled_from_model(records: Sequence[PhotoRecord], model: PosedModel, folder: Path) -> list[PhotoRecord]:
    """Return the records with the model's camera where theirs is unknown, and its place where they state none.

    A model without a reference of its own knows no place on Earth.
    """
    names = [record.path.relative_to(folder).as_posix() for record in records]
    views = views_by_photograph(names, model.views)
    return [
        record.model_copy(update=_known(record, views[index], model)) if index in views else record
        for index, record in enumerate(records)
    ]


def _known(record: PhotoRecord, view: PosedCamera, model: PosedModel) -> dict[str, Any]:
    update: dict[str, Any] = {}
    try:
        camera_of(record)
    except InputError:
        update["user_camera"] = view.camera
    if model.georeference and not record.is_located:
        centre = view.world_from_camera[None, :, 3]
        latitude, longitude, height = (float(value) for value in geodetic_from_enu(centre, model.georeference)[0])
        update |= {"latitude": latitude, "longitude": longitude, "height": height}
        update |= {"altitude_kind": "unknown", "altitude_words": "the imported model's", "position_source": "model"}
    return update


def _match(name: str, indices: dict[str, int]) -> int | None:
    if name in indices:
        return indices[name]
    path = PurePosixPath(name.replace("\\", "/"))
    same_file = [index for known, index in indices.items() if PurePosixPath(known).name == path.name]
    same_stem = [index for known, index in indices.items() if PurePosixPath(known).stem in (path.stem, path.name)]
    candidates = same_file or same_stem
    return candidates[0] if len(candidates) == 1 else None
