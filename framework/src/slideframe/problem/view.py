"""What is seen of the motion: the picture, and the way of the camera."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, Tag, model_validator

from slideframe.arrays import Float32Array, Float64Array
from slideframe.errors import InputError
from slideframe.formats.models import posed_model_files, read_posed_model
from slideframe.formats.posed_camera import PosedCamera, choose_views, posed_cameras
from slideframe.problem.base import ProblemModel, Share, Vector, kind_or
from slideframe.problem.camera_path import Shot, Track, evenly, fit_lens, look_at, pinhole, through_views
from slideframe.products import Camera, Survey

MapName = Literal["depth", "alpha", "normal"]


class ViewModel(ProblemModel):
    """What every view has: the picture."""

    width: int = Field(default=960, ge=16, le=7680, multiple_of=2, description="px")
    height: int = Field(default=540, ge=16, le=4320, multiple_of=2, description="px")
    background: tuple[Share, Share, Share] = Field(default=(0.62, 0.74, 0.86), description="sRGB, 0 to 1")
    supersampling: int = Field(
        default=1, ge=1, le=4, description="each pixel is the mean of this number squared of drawn ones"
    )
    maps: tuple[MapName, ...] = Field(
        default=(), description="also keep of each picture: 'depth' along the view axis in m, 'alpha', 'normal' in ENU"
    )

    @abstractmethod
    def shot(self, survey: Survey, bounds: Float32Array | Float64Array) -> Shot:
        """Return where the camera is at each share of the film.

        `bounds` (2, 3), m, are the lowest and the highest corner of what to look at.

        Raises:
            SlideframeError: the survey or the file that is named has no such view.
        """


class OrbitView(ViewModel):
    """A camera that looks at the moving mass, and may turn around it."""

    kind: Literal["orbit"] = "orbit"
    azimuth: float = Field(default=180.0, description="compass direction from the region to the camera, degrees")
    elevation: float = Field(default=30.0, gt=-90, lt=90, description="degrees above the horizon")
    distance: float | None = Field(
        default=None, gt=0, description="m from the region's centre; none: the region fills the picture"
    )
    turn: float = Field(default=0.0, description="degrees of azimuth that the camera turns during the film")
    field_of_view: float = Field(default=50.0, gt=1, lt=150, description="horizontal, degrees")

    def shot(self, survey: Survey, bounds: Float32Array | Float64Array) -> Shot:
        """Turn about the centre of the bounds; without a given distance their sphere just fits the picture."""
        camera = pinhole(self.width, self.height, self.field_of_view)
        target = np.asarray(bounds, np.float64).mean(axis=0)
        radius = float(np.linalg.norm(np.ptp(bounds, axis=0))) / 2
        half_angle = math.atan(min(self.width, self.height) / (2 * camera.focal_x))
        distance = self.distance or radius / math.sin(half_angle)
        elevation = math.radians(self.elevation)

        def shot(share: float) -> tuple[Camera, Float64Array]:
            azimuth = math.radians(self.azimuth + self.turn * share)
            level = math.cos(elevation)
            outward = np.array([math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(elevation)])
            right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
            return camera, np.column_stack([right, np.cross(-outward, right), -outward, target + distance * outward])

        return shot


class SurveyView(ViewModel):
    """The survey's own views: one photograph's, or a flight through those of several."""

    kind: Literal["survey"] = "survey"
    photographs: tuple[str, ...] = Field(min_length=1, description="their file names, in the order of the flight")
    field_of_view: float | None = Field(
        default=None, gt=1, lt=150, description="horizontal, degrees; none: the photographs' own"
    )

    def shot(self, survey: Survey, bounds: Float32Array | Float64Array) -> Shot:
        """Go evenly through the photographs' cameras."""
        return _through(choose_views(posed_cameras(survey), self.photographs, "view.photographs"), self)


class FlightView(ViewModel):
    """A flight through key frames."""

    kind: Literal["flight"] = "flight"
    positions: tuple[Vector, ...] = Field(min_length=1, description="of the camera, local east, north, up, m")
    targets: tuple[Vector, ...] = Field(
        min_length=1, description="what it looks at from each of them, m, or one for all"
    )
    shares: tuple[Share, ...] = Field(default=(), description="of the film, 0 to 1, at each of them; none: evenly")
    field_of_view: float = Field(default=50.0, gt=1, lt=150, description="horizontal, degrees")

    @model_validator(mode="after")
    def _key_frames_fit(self) -> "FlightView":
        count = len(self.positions)
        if len(self.targets) not in (1, count):
            raise ValueError(f"there are {count} positions but {len(self.targets)} targets: give one each, or one")
        if self.shares and len(self.shares) != count:
            raise ValueError(f"there are {count} positions but {len(self.shares)} shares")
        if any(not before < after for before, after in zip(self.shares, self.shares[1:], strict=False)):
            raise ValueError("shares must rise from each key frame to the next")
        targets = self.targets * (count if len(self.targets) == 1 else 1)
        if any(position == target for position, target in zip(self.positions, targets, strict=True)):
            raise ValueError("a position is its own target: the camera must look somewhere else")
        return self

    def shot(self, survey: Survey, bounds: Float32Array | Float64Array) -> Shot:
        """Go smoothly through the positions, looking at the likewise moving target, held level."""
        camera = pinhole(self.width, self.height, self.field_of_view)
        shares = np.array(self.shares) if self.shares else evenly(len(self.positions))
        positions = Track(shares, np.array(self.positions, np.float64))
        targets = np.broadcast_to(np.array(self.targets, np.float64), positions.values.shape)
        aims = Track(shares, targets)
        return lambda share: (camera, look_at(positions.at(share), aims.at(share)))


class FileView(ViewModel):
    """Views from a file of another program, whose world is the survey's local frame."""

    kind: Literal["file"] = "file"
    path: Annotated[Path, AfterValidator(lambda path: path.expanduser().absolute())] = Field(
        description="a transforms.json, or the folder of a COLMAP model; OpenSfM's and Metashape's are read too"
    )
    views: tuple[str, ...] = Field(default=(), description="names of those to go through; none: all, in their order")
    field_of_view: float | None = Field(
        default=None, gt=1, lt=150, description="horizontal, degrees; none: the file's own"
    )

    def shot(self, survey: Survey, bounds: Float32Array | Float64Array) -> Shot:
        """Go evenly through the file's cameras."""
        known = read_posed_model(self.path).views
        views = choose_views(known, self.views, str(self.path)) if self.views else known
        if not views:
            raise InputError("the file holds no view", where=str(self.path), cure="export the cameras again")
        return _through(views, self)

    def require_files(self) -> None:
        """Raise InputError where one of the model's files is missing."""
        for path in posed_model_files(self.path):
            if not path.is_file():
                raise InputError("the view's cameras are missing", where=str(path), cure="correct view.path")


View = Annotated[
    Annotated[OrbitView, Tag("orbit")]
    | Annotated[SurveyView, Tag("survey")]
    | Annotated[FlightView, Tag("flight")]
    | Annotated[FileView, Tag("file")],
    kind_or("orbit"),
    Field(description="what is seen of the motion"),
]


def _through(views: Sequence[PosedCamera], view: SurveyView | FileView) -> Shot:
    """Return the shot that passes evenly through the views, with their lenses or the field of view asked for."""
    if view.field_of_view is None:
        cameras = [fit_lens(posed.camera, view.width, view.height) for posed in views]
    else:
        cameras = [pinhole(view.width, view.height, view.field_of_view)] * len(views)
    return through_views(cameras, [posed.world_from_camera for posed in views], evenly(len(views)))
