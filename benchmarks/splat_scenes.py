"""Splats and photographs that the benchmarks of `gs_torch` draw and train on."""

import numpy as np
import torch

from slideframe.products import Camera
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.harmonics import C0
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters
from slideframe_gs_torch.views import TrainingView

POSE = np.column_stack([np.eye(3), np.zeros(3)])
DEGREE = 1  # of the harmonics, as in training by default

Splats = list[torch.Tensor]


def camera_of(width: int, height: int) -> Camera:
    return Camera(
        width=width,
        height=height,
        focal_x=0.9 * width,
        focal_y=0.9 * width,
        principal_x=width / 2,
        principal_y=height / 2,
    )


def random_splats(count: int, seed: int = 0) -> Splats:
    """Return splats 2 to 8 m before the camera, all over its picture, with float32 parameters.

    At 640 px a splat touches some 5 tiles on average, as those trained on the demo survey (3.8 to 4.5) and on
    Mirafiori (5.0 to 5.6) do in the survey's views.
    """
    random = np.random.default_rng(seed)
    depth = random.uniform(2, 8, count)
    arrays = [
        np.column_stack([random.uniform(-0.6, 0.6, count) * depth, random.uniform(-0.45, 0.45, count) * depth, depth]),
        random.normal(size=(count, 4)),
        np.exp(random.normal(-4.0, 0.5, (count, 3))),
        random.uniform(0.05, 0.98, count),
        random.uniform(0, 1, (count, 3)),
    ]
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


def training_state(splats: Splats, iteration: int = 0) -> State:
    """Return the state of a training that has come to these splats and shows one photograph."""
    centers, rotations, scales, opacities, colours = splats
    raw = {
        "centers": centers,
        "rotations": rotations,
        "log_scales": scales.log(),
        "logits": opacities.logit(),
        "harmonics": torch.nn.functional.pad(((colours - 0.5) / C0)[:, None], (0, 0, 0, (DEGREE + 1) ** 2 - 1)),
    }
    parameters = Parameters({name: tensor.clone() for name, tensor in raw.items()})
    return State(parameters, Adam(), torch.zeros(len(centers)), len(centers), Exposures.of(1), iteration)


def photograph(camera: Camera) -> TrainingView:
    """Return noise that training may take for a photograph."""
    random = torch.Generator().manual_seed(3)
    pixels = torch.randint(0, 256, (3, camera.height, camera.width), dtype=torch.uint8, generator=random)
    return TrainingView("noise", pixels, None, camera, POSE)
