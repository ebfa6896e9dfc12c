"""The demo survey, small, with the truth that its generator keeps."""

import atexit
import hashlib
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from slideframe.arrays import Float32Array, Float64Array, UInt8Array
from slideframe.demo import write_demo_survey
from slideframe.problem import Site
from slideframe.products import Camera, Georeference, Photograph, Survey
from slideframe.testing.drawing import project

# Large enough to match photographs with one another, and small enough to learn them quickly.
SITE_WIDTH, SITE_COUNT = 640, 14
SURVEY_WIDTH, SURVEY_COUNT = 160, 8
RTK_SIGMA = 0.03


@cache
def demo_folder(width: int, photograph_count: int) -> Path:
    """Return the folder of a small demo survey, written once a process and removed at its end."""
    folder = Path(tempfile.mkdtemp(prefix="slideframe-demo-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    write_demo_survey(folder / "survey", width=width, photograph_count=photograph_count)
    return folder / "survey"


def demo_site() -> Site:
    """Return the demo survey as a pose source is given it."""
    return Site(photographs=demo_folder(SITE_WIDTH, SITE_COUNT) / "photographs")


def site_truth() -> dict[str, Any]:
    """Return `cameras.json`, the true cameras of `demo_site`."""
    return _true_cameras(demo_folder(SITE_WIDTH, SITE_COUNT))


def _true_cameras(folder: Path) -> dict[str, Any]:
    truth: dict[str, Any] = json.loads((folder / "ground_truth" / "cameras.json").read_text())
    return truth


@cache
def demo_survey() -> Survey:
    """Return a smaller demo survey with its true cameras and true points of the ground."""
    folder = demo_folder(SURVEY_WIDTH, SURVEY_COUNT)
    truth = _true_cameras(folder)
    camera, points = Camera(**truth["camera"]), ground_points(folder, 1.5)
    paths = [folder / "photographs" / name for name in truth["world_from_camera"]]
    poses = np.array(list(truth["world_from_camera"].values()), np.float64)
    return Survey(
        georeference=Georeference(**truth["origin"]),
        cameras=(camera,),
        photographs=tuple(
            Photograph(path=path, camera=0, sha256=hashlib.sha256(path.read_bytes()).hexdigest()) for path in paths
        ),
        world_from_camera=poses,
        position_sigma=np.full((len(paths), 3), RTK_SIGMA),
        sparse_points=points,
        sparse_colors=photographed_colors(points, paths, camera, poses),
        sparse_errors=np.full(len(points), 0.5, np.float32),
    )


def ground_points(folder: Path, spacing: float) -> Float32Array:
    """Return points of the true ground about `spacing` metres apart, (n, 3), m."""
    with np.load(folder / "ground_truth" / "terrain.npz") as terrain:
        step = max(1, round(spacing / float(terrain["x"][1] - terrain["x"][0])))
        x, y, heights = terrain["x"][::step], terrain["y"][::step], terrain["heights"][::step, ::step]
    return np.stack([*np.meshgrid(x, y), heights], axis=-1).reshape(-1, 3).astype(np.float32)


def photographed_colors(points: Float32Array, paths: list[Path], camera: Camera, poses: Float64Array) -> UInt8Array:
    """Return the mean colour (n, 3) of points (n, 3), m, in the photographs that show them; grey where none does."""
    total, count = np.zeros((len(points), 3)), np.zeros(len(points))
    for path, pose in zip(paths, poses, strict=True):
        seen = (points - pose[:, 3]) @ pose[:, :3]
        column, row = np.floor(project(seen, camera)).astype(int).T
        inside = (seen[:, 2] > 1) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        with Image.open(path) as image:
            total[inside] += np.asarray(image.convert("RGB"))[row[inside], column[inside]]
        count[inside] += 1
    mean = np.divide(total, count[:, None], out=np.full_like(total, 128), where=count[:, None] > 0)
    return mean.astype(np.uint8)
