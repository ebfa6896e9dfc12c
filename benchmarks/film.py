"""How fast a moving scene is drawn, against the raw forward pass of the rasteriser alone.

    python benchmarks/film.py [--run FOLDER] [--frames N]

Without a run, a made-up slope of 172 000 splats slides, of which 90 000 follow 73 000 particles: the numbers of the
embedded demo. Each frame is drawn twice, interleaved: as the renderer does it (deform, colour, rasterise, to 8 bits),
and by `rasterize()` alone on what the renderer deformed. Then come frames in which nothing moves, and a camera
that sees little; of the made-up slope also fewer splats, and the memory that a short and a long film need.
Compiling is over before.
"""

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from machine import print_machine

from slideframe.coupling import Coupling, MovedSplats, clamp_stretch
from slideframe.device import Device
from slideframe.problem import FlightView, OrbitView, View
from slideframe.products import Camera, Filling, ParticleFrame, SplatCloud, Survey
from slideframe.stages import Context
from slideframe.stored_run import StoredRun
from slideframe.testing.ground_scenes import hillside_survey
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.threads import one_torch_thread, thread_count
from slideframe_render_gs.drawing import draw
from slideframe_render_gs.film import pictures
from slideframe_render_gs.moving_scene import MovingScene

GROUND, PARTICLES_ACROSS, LAYERS = 315, 78, 12
SHORT_AND_LONG = 30, 300  # frames


def cloud(centers: np.ndarray, size: Sequence[float], coefficients: int, opacity: float, seed: int) -> SplatCloud:
    random = np.random.default_rng(seed)
    count = len(centers)
    rotations = random.normal(size=(count, 4)) * [1, 0.1, 0.1, 1]
    harmonics = 0.05 * random.normal(size=(count, coefficients, 3))
    harmonics[:, 0] = random.uniform([-0.6, -0.4, -0.9], [0.2, 0.4, -0.3], (count, 3))
    return SplatCloud(
        centers=centers.astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=(np.asarray(size) * random.uniform(0.6, 1.4, (count, 3))).astype(np.float32),
        opacities=np.full(count, opacity, np.float32),
        harmonics=harmonics.astype(np.float32),
    )


def slope(ground: int = GROUND, across: int = PARTICLES_ACROSS) -> tuple[SplatCloud, Filling, list[ParticleFrame]]:
    """A slope of 1 in 2, 100 m wide, whose middle slides, shears and spreads."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-50, 50, ground), np.linspace(-50, 50, ground)))
    size = 0.3 * GROUND / ground
    splats = cloud(np.stack([x, y, -0.5 * y], axis=1), (size, size, 0.3 * size), 4, 0.95, 0)
    spacing = 40 / across
    along = (np.arange(across) + 0.5) * spacing - 20
    lattice = np.stack(np.meshgrid(along, along, np.arange(LAYERS), indexing="ij"), axis=-1).reshape(-1, 3)
    particles = lattice * [1, 1, -spacing] - [0, 0, 0.5 * spacing]
    particles[:, 2] -= 0.5 * lattice[:, 1]
    inside = (np.abs(x) < 20) & (np.abs(y) < 20)
    column = np.floor((np.stack([x, y], axis=1) + 20) / spacing).clip(0, across - 1).astype(np.int64)
    carrier = (column @ [across, 1]) * LAYERS
    filling = Filling(
        bounds=np.array([[-20.0, -20, -20], [20, 20, 12]]),
        particle_positions=particles.astype(np.float32),
        particle_volumes=np.full(len(particles), spacing**3, np.float32),
        interior=cloud(particles, (0.5 * spacing, 0.5 * spacing, 0.4 * spacing), 1, 0.95, 1),
        interior_particles=np.arange(len(particles), dtype=np.int32),
        surface_particles=np.where(inside, carrier, -1).astype(np.int32),
        surface_vertices=np.zeros((3, 3), np.float32),
        surface_triangles=np.zeros((1, 3), np.int32),
        surface_support=np.zeros(3, np.uint8),
    )
    return splats, filling, [sliding(filling, 0.1 * index) for index in range(12)]


def sliding(filling: Filling, moment: float) -> ParticleFrame:
    """Each particle goes its own way, faster near the surface, and is sheared and turned on it."""
    start = filling.particle_positions.astype(np.float64)
    random = np.random.default_rng(2)
    speed = 4 + 2 * random.random((len(start), 1))
    positions = start + moment * speed * [0, 1, -0.5]
    F = np.eye(3) + moment * 0.6 * random.normal(size=(len(start), 3, 3)) * (moment > 0)
    return ParticleFrame(
        time=moment,
        positions=positions.astype(np.float32),
        velocities=np.zeros_like(filling.particle_positions),
        deformation_gradients=clamp_stretch(F)[0].astype(np.float32),  # solvers hold it too
    )


def raw(moved: MovedSplats, camera: Camera, pose: np.ndarray, view: View) -> None:
    """Do no more than call the rasteriser; torch's threads, which spin after their part, would slow what comes next."""
    with torch.no_grad(), one_torch_thread():
        arrays = (moved.centers, moved.rotations, moved.scales, moved.opacities, moved.harmonics)
        rasterize(
            *map(torch.from_numpy, arrays),
            camera=camera,
            world_from_camera=pose,
            background=view.background,
            frame_rotations=moved.frame_rotations,
        )


def timed(work: Callable[[], Any]) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)


def compare(title: str, scene: MovingScene, frames: Sequence[ParticleFrame], survey: Survey, view: View) -> float:
    """Print medians over the frames, and the median of the ratios frame by frame; return CPU ms of a frame."""
    camera, pose = view.shot(survey, np.array([[-20.0, -20, -12], [20, 20, 12]]))(0.5)
    whole, alone = [], []
    for index, frame in enumerate([frames[0], *frames]):
        whole.append(timed(lambda frame=frame: draw(scene.at(frame, camera, pose), camera, pose, view)))
        moved = scene.at(frame, camera, pose)
        alone.append(timed(lambda moved=moved: raw(moved, camera, pose, view)))
        if not index:  # compiles
            whole.clear()
            alone.clear()
    ours, theirs = np.array(whole), np.array(alone)
    wall, cpu = np.median(ours, axis=0)
    raw_wall, raw_cpu = np.median(theirs, axis=0)
    ratio, cpu_ratio = np.median(ours / theirs, axis=0)
    print(
        f"{title:<28}{wall:7.1f} ms a frame ({cpu:6.1f} CPU), {1e3 / wall:5.1f} frames/s; raw {raw_wall:7.1f} ms "
        f"({raw_cpu:6.1f} CPU); ratio {ratio:.2f} ({cpu_ratio:.2f} CPU)",
        flush=True,
    )
    return float(cpu)


def print_memory(survey: Survey, splats: SplatCloud, filling: Filling, view: View) -> None:
    """Print the greatest memory of this process after a short film and after a long one of the same motion."""
    for count in SHORT_AND_LONG:
        motion = (sliding(filling, 1.2 * index / count) for index in range(count))
        with tempfile.TemporaryDirectory() as scratch:
            context = Context(device=Device(), scratch=Path(scratch))
            shown = sum(1 for _ in pictures(survey, splats, filling, motion, view, context))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"a film of {shown} frames: {peak:.0f} MiB at its peak", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path, help="a finished run, instead of the made-up slope")
    parser.add_argument("--frames", type=int, default=11)
    options = parser.parse_args()
    print_machine("slideframe-render-gs", "slideframe-gs-torch", "torch", "numba", "numpy")
    survey, view = hillside_survey(), OrbitView(elevation=35)
    if options.run:
        run = StoredRun(options.run)
        survey, splats, filling = run.survey, run.splats, run.filling
        view, frames = run.config.view, [run.motion[i] for i in np.linspace(0, len(run.motion) - 1, 40).astype(int)]
    else:
        splats, filling, frames = slope()
    coupling = Coupling(splats, filling)
    frames = [frames[i] for i in np.linspace(1, len(frames) - 1, options.frames).astype(int)]
    print(f"{len(coupling):,} splats, {len(coupling.moving):,} on {len(filling.particle_positions):,} particles")
    print(f"{view.width} x {view.height} px, {thread_count()} threads")
    aside = FlightView(positions=((45, 45, 30),), targets=((60, 60, -30),))
    cost = compare("everything moves", MovingScene(coupling), frames, survey, view)
    compare("nothing moves", MovingScene(coupling), [frames[-1]] * options.frames, survey, view)
    compare("all moves out of the picture", MovingScene(coupling), frames, survey, aside)
    if not options.run:
        few, ground, motion = slope(GROUND // 2, PARTICLES_ACROSS // 2)
        fewer = Coupling(few, ground)
        less = compare(f"{len(fewer):,} splats move", MovingScene(fewer), motion[1:], survey, view)
        print(f"{len(coupling) / len(fewer):.1f} times the splats cost {cost / less:.1f} times the CPU time")
        print_memory(survey, splats, filling, view)


if __name__ == "__main__":
    main()
