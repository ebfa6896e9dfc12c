"""The photographs as training sees them: undistorted, reduced, and halved for the start."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from slideframe.arrays import Float32Array, Float64Array
from slideframe.photographs import load_photograph
from slideframe.products import Camera, Survey
from slideframe.stages import Context
from slideframe_gs_torch.depth_points import DepthPoints, depth_points
from slideframe_gs_torch.sky import sky_pixels

# A reduced photograph narrower than this says too little to train on.
NARROWEST = 64


@dataclass(frozen=True)
class TrainingView:
    """One photograph: pixels (3, height, width) uint8, mask (height, width) or None, camera and pose.

    `sky` (height, width) is where no splat may stand, and the mask leaves it out. `index` is its place among the
    survey's photographs, `depths` what its sparse points say, where that is wanted.
    """

    name: str
    pixels: Tensor
    mask: Tensor | None
    camera: Camera
    world_from_camera: Float64Array
    index: int = 0
    depths: DepthPoints | None = None
    sky: Tensor | None = None

    @property
    def truth(self) -> Tensor:
        """Colours from 0 to 1."""
        return self.pixels.float().div_(255)

    def reduced(self, factor: int) -> "TrainingView":
        """Return the view with blocks of factor x factor pixels averaged; odd edges are cut off."""
        if factor == 1 or self.camera.width // factor < NARROWEST:
            return self
        height, width = self.camera.height // factor, self.camera.width // factor
        cut = self.pixels[:, : height * factor, : width * factor].float()
        pixels = torch.nn.functional.avg_pool2d(cut[None], factor)[0].round().to(torch.uint8)
        camera = self.camera.model_copy(
            update={
                "width": width,
                "height": height,
                "focal_x": self.camera.focal_x / factor,
                "focal_y": self.camera.focal_y / factor,
                "principal_x": self.camera.principal_x / factor,
                "principal_y": self.camera.principal_y / factor,
            }
        )
        mask, sky = (
            None if plane is None else _all_of_blocks(plane[: height * factor, : width * factor], factor)
            for plane in (self.mask, self.sky)
        )
        return replace(self, pixels=pixels, mask=mask, sky=sky, camera=camera)

    def with_depths(self, points: Float32Array) -> "TrainingView":
        """Return the view with the depths of the sparse points (point, 3) that it sees."""
        return replace(self, depths=depth_points(points, self.camera, self.world_from_camera))


def _all_of_blocks(plane: Tensor, factor: int) -> Tensor:
    """Tell for each block of factor x factor pixels whether all are true."""
    height, width = plane.shape
    return plane.reshape(height // factor, factor, width // factor, factor).all(dim=3).all(dim=1)


def load_views(
    survey: Survey, indices: Iterable[int], width: int, context: Context, *, clear_sky: bool = True
) -> Iterator[TrainingView]:
    """Read photographs at training size, one by one; those of which masks leave nothing are left out with a warning.

    With `clear_sky` what shows the sky is known, and left out by the mask.

    Raises:
        InputError: one can't be read.
    """
    for index in indices:
        pixels, camera, mask = load_photograph(survey, index, width=width)
        name = survey.photographs[index].name
        sky = sky_pixels(survey.sparse_points, camera, survey.world_from_camera[index]) if clear_sky else None
        if sky is not None:
            mask = ~sky if mask is None else mask & ~sky
        if mask is not None and not mask.any():
            context.warn(f"{name} is left out: its mask, its lens or the sky leaves nothing of it")
            continue
        planes = torch.from_numpy(np.array(pixels.transpose(2, 0, 1), order="C"))
        seen, above = (None if part is None else torch.from_numpy(part) for part in (mask, sky))
        yield TrainingView(name, planes, seen, camera, survey.world_from_camera[index], index, sky=above)
