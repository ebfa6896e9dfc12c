"""What is seen of the motion."""

import math

import numpy as np
from pydantic import Field

from slideframe.arrays import Float32Array, Float64Array
from slideframe.problem.base import ProblemModel, Share
from slideframe.products import Camera


class View(ProblemModel):
    """The camera of the film, looking at the region."""

    width: int = Field(default=960, ge=16, le=7680, multiple_of=2, description="px")
    height: int = Field(default=540, ge=16, le=4320, multiple_of=2, description="px")
    azimuth: float = Field(default=180.0, description="compass direction from the region to the camera, degrees")
    elevation: float = Field(default=30.0, gt=-90, lt=90, description="degrees above the horizon")
    distance: float | None = Field(
        default=None, gt=0, description="m from the region's centre; none: the region fills the picture"
    )
    turn: float = Field(default=0.0, description="degrees of azimuth that the camera turns during the film")
    field_of_view: float = Field(default=50.0, gt=1, lt=150, description="horizontal, degrees")
    background: tuple[Share, Share, Share] = Field(default=(0.62, 0.74, 0.86), description="sRGB, 0 to 1")

    def camera(self, share: float, bounds: Float32Array) -> tuple[Camera, Float64Array]:
        """Return the camera and its world_from_camera (3, 4) when `share` (0 to 1) of the film has passed.

        `bounds` (2, 3), m, are the lowest and highest corner of what to look at; its centre is the
        target, and without a given distance its bounding sphere just fits the picture.
        """
        focal = self.width / (2 * math.tan(math.radians(self.field_of_view) / 2))
        camera = Camera(
            width=self.width,
            height=self.height,
            focal_x=focal,
            focal_y=focal,
            principal_x=self.width / 2,
            principal_y=self.height / 2,
        )
        target = np.asarray(bounds, np.float64).mean(axis=0)
        radius = float(np.linalg.norm(np.ptp(bounds, axis=0))) / 2
        half_angle = math.atan(min(self.width, self.height) / (2 * focal))
        distance = self.distance or radius / math.sin(half_angle)
        azimuth, elevation = math.radians(self.azimuth + self.turn * share), math.radians(self.elevation)
        outward = np.array(
            [math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
        )
        right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
        down = np.cross(-outward, right)
        return camera, np.column_stack([right, down, -outward, target + distance * outward])
