"""From frames of particles to pictures, one at a time."""

import time
from collections.abc import Iterable, Iterator, Sized

import numpy as np
import torch

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.coupling import Coupling, MovedSplats
from slideframe.problem import View
from slideframe.products import Camera, Filling, ParticleFrame, Picture, SplatCloud
from slideframe.stages import Context
from slideframe_gs_torch.rasterize import rasterize


def pictures(
    splats: SplatCloud, filling: Filling, motion: Iterable[ParticleFrame], view: View, context: Context
) -> Iterator[Picture]:
    """Yield one picture per frame; memory is that of one frame.

    The camera turns evenly over the film where the motion knows its length; else it stands still.
    """
    coupling = Coupling(splats, filling)
    bounds = np.stack([filling.particle_positions.min(axis=0), filling.particle_positions.max(axis=0)])
    count = len(motion) if isinstance(motion, Sized) else 0
    if view.turn and not count:
        context.warn("the length of the film is not known beforehand, so the camera does not turn")
    context.figure("splats", len(coupling))
    seconds = 0.0
    for index, frame in enumerate(motion):
        began = time.perf_counter()
        camera, pose = view.camera(index / max(count - 1, 1) if count else 0.0, bounds)
        pixels = draw(coupling.at(frame), camera, pose, view.background)
        seconds += time.perf_counter() - began
        context.figure("frames_per_second", (index + 1) / seconds)
        context.progress(index + 1, max(count, index + 1))
        yield Picture(time=frame.time, pixels=pixels)


def draw(
    moved: MovedSplats, camera: Camera, world_from_camera: Float64Array, background: tuple[float, float, float]
) -> UInt8Array:
    """Return the picture (height, width, 3) of moved splats, their harmonics turned with the ground."""
    with torch.no_grad():
        raster = rasterize(
            torch.from_numpy(moved.centers),
            torch.from_numpy(moved.rotations),
            torch.from_numpy(moved.scales),
            torch.from_numpy(moved.opacities),
            torch.from_numpy(moved.harmonics),
            camera=camera,
            world_from_camera=world_from_camera,
            background=background,
            frame_rotations=moved.frame_rotations if moved.harmonics.shape[1] > 1 else None,
        )
        levels = raster.colour.clamp(0, 1).mul(255).round().to(torch.uint8)
    return np.ascontiguousarray(levels.numpy())
