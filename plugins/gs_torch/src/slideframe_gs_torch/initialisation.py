"""The splats that training starts from."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Survey
from slideframe.stages import Context
from slideframe_gs_torch.dense_start import dense_points
from slideframe_gs_torch.harmonics import C0
from slideframe_gs_torch.parameters import Parameters
from slideframe_gs_torch.views import TrainingView

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

FEWEST_POINTS = 100
FALLBACK_POINTS = 5000
# Half opaque and narrow: each point shows its colour, and lets its neighbours show theirs.
START_OPACITY, START_SIZE = 0.5, 0.6
NEIGHBOURS = 3


def initial_parameters(survey: Survey, shown: Sequence[TrainingView], options: "TorchSplats", seed: int) -> Parameters:
    """Return one splat per point, a little narrower than the mean distance to its three nearest neighbours.

    The points are the sparse ones and those between them. A survey with fewer than FEWEST_POINTS sparse points starts
    from grey random ones.
    """
    random, budget = np.random.default_rng(seed), options.splat_budget
    points, colours = survey.sparse_points, survey.sparse_colors.astype(np.float32) / 255
    if len(points) < FEWEST_POINTS:
        points = random_points(survey, min(FALLBACK_POINTS, budget), random)
        colours = np.full_like(points, 0.5)
    else:
        points, colours = dense_points(survey, shown, int(options.start_share * budget))
    if len(points) > budget:
        kept = np.sort(random.choice(len(points), budget, replace=False))
        points, colours = points[kept], colours[kept]
    sizes = START_SIZE * neighbour_distances(points)
    count = len(points)
    harmonics = torch.zeros(count, (options.harmonics_degree + 1) ** 2, 3)
    harmonics[:, 0] = torch.tensor((colours - 0.5) / C0)
    rotations = torch.zeros(count, 4)
    rotations[:, 0] = 1
    return Parameters(
        {
            "centers": torch.tensor(points),
            "rotations": rotations,
            "log_scales": torch.tensor(np.log(sizes))[:, None].repeat(1, 3),
            "logits": torch.full((count,), math.log(START_OPACITY / (1 - START_OPACITY))),
            "harmonics": harmonics,
        }
    )


def warn_of_few_points(survey: Survey, context: Context) -> None:
    """Tell the user where splats start at random."""
    if len(survey.sparse_points) < FEWEST_POINTS:
        context.warn(
            f"the survey has only {len(survey.sparse_points)} sparse points: splats start at random in front of the "
            "cameras, which takes longer and may leave floaters"
        )


def neighbour_distances(points: Float32Array) -> Float32Array:
    """Return the mean distance to the nearest three points, kept within a factor of 10 of the median."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=min(NEIGHBOURS + 1, len(points)))
    mean = np.asarray(distances)[:, 1:].mean(axis=1)
    middle = max(float(np.median(mean)), 1e-6)
    return np.asarray(mean.clip(0.1 * middle, 10 * middle), np.float32)


def scene_extent(survey: Survey) -> float:
    """Return the length that steps of positions are measured by: the median distance of camera and scene, m."""
    cameras = survey.world_from_camera[:, :, 3]
    if len(survey.sparse_points) < FEWEST_POINTS:
        return max(float(np.ptp(cameras, axis=0).max()), 1.0)
    middle = np.median(survey.sparse_points, axis=0)
    return max(float(np.median(np.linalg.norm(cameras - middle, axis=1))), 1e-3)


def random_points(survey: Survey, count: int, random: np.random.Generator) -> Float32Array:
    """Scatter points along rays of random photographs, 0.5 to 2 flight extents away."""
    poses: Float64Array = survey.world_from_camera[random.integers(len(survey.photographs), size=count)]
    depth = scene_extent(survey) * random.uniform(0.5, 2.0, count)
    camera = survey.cameras[0]
    slope_x = random.uniform(-0.5, 0.5, count) * camera.width / camera.focal_x
    slope_y = random.uniform(-0.5, 0.5, count) * camera.height / camera.focal_y
    rays = np.stack([slope_x, slope_y, np.ones(count)], axis=1) * depth[:, None]
    return np.asarray(np.einsum("nij,nj->ni", poses[:, :, :3], rays) + poses[:, :, 3], np.float32)
