"""What the sky in oblique photographs does to the splats, with `sky = "clear"` and `sky = "keep"`.

    python benchmarks/sky.py [--iterations N] [--picture PICTURE.jpg]

The demo's slope is photographed by its own camera from poses that see over its ridge, with a sky that has clouds in it;
sparse points lie on the true ground. Printed are the PSNR of the ground in photographs held out, and what hangs in the
air: which share of the splats, more than 5 m over the true ground, and which share of those photographs' sky they
cover. The picture has, for each option, a photograph held out, its splats over white, and the site from outside.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch
from machine import print_machine
from PIL import Image

from slideframe.demo.flight import FLIGHT_MEAN, rotation_from_gimbal
from slideframe.demo.lens import pixel_rays
from slideframe.demo.scene import Scene, build_scene
from slideframe.device import Device
from slideframe.products import Camera, Georeference, Photograph, SplatCloud, Survey
from slideframe.stages import Context
from slideframe_gs_torch.evaluation import draw_view, likeness
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_gs_torch.views import TrainingView, load_views

CAMERA = Camera(width=400, height=300, focal_x=282.0, focal_y=282.0, principal_x=200.0, principal_y=150.0)
# x, y, z of first and last photograph in the site's frame, m; how many; yaw and pitch, degrees
LINES = (
    ((-40.0, -70.0, 40.0), (40.0, -72.0, 40.0), 9, 0.0, -14.0),
    ((-45.0, -45.0, 58.0), (45.0, -45.0, 58.0), 9, 5.0, -24.0),
    ((-36.0, -30.0, 70.0), (36.0, -30.0, 70.0), 7, -5.0, -60.0),
    ((60.0, -50.0, 45.0), (52.0, 0.0, 60.0), 5, -55.0, -16.0),
    ((-60.0, 0.0, 60.0), (-56.0, -50.0, 45.0), 5, 55.0, -16.0),
)
SHOWN = 8  # held out, of the first line
FLOATING = 5.0  # m over the ground
REACH = np.arange(2.0, 500.0, 0.5, dtype=np.float32)  # m, where rays over the horizon look for the ridge
HAZE = (165.0, 175.0, 170.0)  # of the land beyond what is modelled
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def poses() -> np.ndarray:
    """Return world_from_camera (photograph, 3, 4) in the site's frame."""
    return np.stack(
        [
            np.column_stack([rotation_from_gimbal(yaw, pitch, 0.0), position])
            for first, last, count, yaw, pitch in LINES
            for position in np.linspace(first, last, count)
        ]
    )


def distances(scene: Scene, pose: np.ndarray) -> np.ndarray:
    """Return how far along each ray of the camera the ground is met (row, column), infinite in the sky."""
    rays = pixel_rays(CAMERA) @ pose[:, :3].T.astype(np.float32)
    found = np.full(rays.shape[:2], np.inf, np.float32)
    steep = rays[..., 2] < -0.1
    heights, grid, side = scene.terrain.heights, scene.terrain.grid, np.abs(scene.terrain.grid.axis).max()
    for row in range(CAMERA.height):
        if steep[row].all():
            break
        x, y, z = (pose[axis, 3] + REACH[:, None] * rays[row, :, axis] for axis in range(3))
        below = (z <= grid.lookup(heights, x.astype(np.float32), y.astype(np.float32))) & (np.abs(x) < side)
        below &= np.abs(y) < side
        found[row] = np.where(below.any(axis=0), REACH[below.argmax(axis=0)], np.inf)
    first = row if steep[row].all() else CAMERA.height
    found[first:] = scene.ground.cast(pose[:, 3], rays[first:])
    return found


def expose(scene: Scene, pose: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Return the photograph (height, width, 3): the ground as the demo colours it, over it a sky with clouds."""
    rays = pixel_rays(CAMERA) @ pose[:, :3].T.astype(np.float32)
    up = rays[..., 2] / np.linalg.norm(rays, axis=-1)
    azimuth = np.arctan2(rays[..., 0], rays[..., 1])
    clouds = np.clip(np.sin(9 * azimuth) * np.sin(40 * up + 3 * azimuth) + 0.3 * np.sin(31 * azimuth), 0, 1)
    blue = np.array([120.0, 165, 225]) + 70 * np.exp(-6 * np.clip(up, 0, 1))[..., None]
    picture = blue + (245 - blue) * clouds[..., None]
    picture[up <= 0] = HAZE
    met = np.isfinite(reach)
    x, y = (np.float32(pose[axis, 3]) + reach[met] * rays[met][:, axis] for axis in (0, 1))
    picture[met] = scene.appearance.colors(x, y, reach[met] / np.float32(CAMERA.focal_x)).T
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def survey_of(scene: Scene, folder: Path) -> Survey:
    """Photograph the site into a folder; sparse points are what every eighth pixel of the ground shows."""
    photographs, points, colours = [], [], []
    for index, pose in enumerate(poses()):
        reach = distances(scene, pose)
        picture = expose(scene, pose, reach)
        path = folder / f"{index:02d}.png"
        Image.fromarray(picture).save(path)
        photographs.append(Photograph(path=path, camera=0, sha256=""))
        coarse = reach[4::8, 4::8]
        met = np.isfinite(coarse) & (coarse < 200)
        rays = (pixel_rays(CAMERA) @ pose[:, :3].T.astype(np.float32))[4::8, 4::8][met]
        points.append(pose[:, 3] + coarse[met][:, None] * rays)
        colours.append(picture[4::8, 4::8][met])
    local = poses()
    local[:, :, 3] -= FLIGHT_MEAN
    sparse = np.concatenate(points)[::3] - FLIGHT_MEAN
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(CAMERA,),
        photographs=tuple(photographs),
        world_from_camera=local,
        position_sigma=np.full((len(local), 3), 0.02),
        sparse_points=sparse.astype(np.float32),
        sparse_colors=np.concatenate(colours)[::3],
        sparse_errors=np.ones(len(sparse), np.float32),
    )


def in_the_air(scene: Scene, splats: SplatCloud) -> np.ndarray:
    """Return which splats hang over the ground."""
    x, y, z = (splats.centers + FLIGHT_MEAN.astype(np.float32)).T
    return z > scene.terrain.grid.lookup(scene.terrain.heights, x, y) + FLOATING


def seen(splats: SplatCloud, pose: np.ndarray) -> torch.Tensor:
    view = TrainingView("", torch.zeros(3, 1, 1, dtype=torch.uint8), None, CAMERA, pose)
    return draw_view(splats, view, WHITE)


def sky_covered(splats: SplatCloud, views: list[TrainingView]) -> float:
    """Return the mean share of light from the views' sky that splats keep off."""
    stopped = [1 - (draw_view(splats, view, WHITE) - draw_view(splats, view, BLACK)).mean(dim=0) for view in views]
    parts = [light[view.sky] for light, view in zip(stopped, views, strict=True) if view.sky is not None]
    return float(torch.cat(parts).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=1500)
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    print_machine("slideframe-gs-torch", "torch", "numba", "numpy")
    folder = Path(tempfile.mkdtemp())
    scene = build_scene(CAMERA.width)
    survey = survey_of(scene, folder)
    context = Context(device=Device(), scratch=folder)
    held_out = list(load_views(survey, range(0, len(survey.photographs), 8), CAMERA.width, context))
    outside = np.column_stack([rotation_from_gimbal(20.0, -12.0, 0.0), np.array([-80.0, -190, 90]) - FLIGHT_MEAN])
    rows = []
    for sky in ("keep", "clear"):
        options = TorchSplats(
            iterations=arguments.iterations, splat_budget=60_000, image_width=CAMERA.width, sky=sky, settle_gain=0
        )
        scratch = folder / sky
        scratch.mkdir()
        splats = options.reconstruct(survey, Context(device=Device(), scratch=scratch))
        hanging = in_the_air(scene, splats)
        ratios = [likeness(splats, view, (0.5, 0.5, 0.5)).psnr for view in held_out]
        print(f'sky = "{sky}": {len(splats):,} splats; ground held out {np.mean(ratios):.2f} dB before grey; ', end="")
        print(f"{hanging.mean():.1%} of the splats in the air, ", end="")
        print(f"{sky_covered(splats, held_out):.1%} of the sky covered", flush=True)
        view = next(view for view in held_out if view.index == SHOWN)
        rows.append(torch.cat([view.truth, draw_view(splats, view, WHITE), seen(splats, outside)], dim=2))
    if arguments.picture:
        grid = torch.cat(rows, dim=1).permute(1, 2, 0).mul(255).round().to(torch.uint8)
        Image.fromarray(grid.numpy()).save(arguments.picture, quality=88)


if __name__ == "__main__":
    main()
