"""A camera and where it stands: what the camera files of other programs hold of a photograph or a film."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.products import Camera, Survey


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """One view.

    Attributes:
        name: of its picture, a path below the folder of pictures, with forward slashes.
        camera: its lens and size, px.
        world_from_camera: (3, 4), m, camera axes x right, y down, z forward.
    """

    name: str
    camera: Camera
    world_from_camera: Float64Array


def posed_cameras(survey: Survey) -> list[PosedCamera]:
    """Return the survey's photographs as views, named by their files."""
    return [
        PosedCamera(photograph.name, survey.camera_of(index), survey.world_from_camera[index])
        for index, photograph in enumerate(survey.photographs)
    ]


def choose_views(views: Sequence[PosedCamera], names: Sequence[str], where: str) -> list[PosedCamera]:
    """Return the views of those names, in that order; an extension may be left out.

    Raises:
        InputError: there is none of a name, or more than one.
    """
    return [_only_view(views, name, where) for name in names]


def _only_view(views: Sequence[PosedCamera], name: str, where: str) -> PosedCamera:
    known = [view.name for view in views]
    found = [view for view in views if view.name == name] or [
        view for view in views if name in (view.name.rpartition(".")[0], view.name.rpartition("/")[2])
    ]
    if len(found) == 1:
        return found[0]
    near = get_close_matches(name, known, n=3, cutoff=0.3) or known[:3]
    raise InputError(
        f"there are {len(found)} views named '{name}'" if found else f"there is no view named '{name}'",
        where=where,
        cure=f"name one of the {len(known)}, such as {', '.join(near)}" if known else "name a file that has views",
    )
