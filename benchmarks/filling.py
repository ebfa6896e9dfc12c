"""What filling a region costs and how good it is.

    python benchmarks/filling.py scene RUN_FOLDER [--modes engineering paper] [--every N]
    python benchmarks/filling.py scaling [--splats N ...] [--particles N ...]

`scene` fills the region of a finished run and compares: the surface with the reference ground that the run's config
names (the demo's is its true ground), and what the survey's cameras see at t = 0 with the photographs: the scan
alone, then with all inferred splats drawn, as if nothing hid them, then as the film does.

`scaling` fills a synthetic hillside, each size in a process of its own, and fits time = a N^b.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import torch
from machine import print_machine

from slideframe.config import RunConfig
from slideframe.coupling import Coupling
from slideframe.device import Device
from slideframe.photographs import load_photograph
from slideframe.problem import BoxRegion, FillingProblem
from slideframe.products import Camera, Filling, Georeference, ParticleFrame, Photograph, SplatCloud, Survey
from slideframe.quality.surface import compare_surface
from slideframe.release.plan import plan_of
from slideframe.stages import Context
from slideframe.store import Store
from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_gs_torch.rasterize import rasterize

WIDTH = 640  # px
BACKGROUND = (0.62, 0.74, 0.86)
PARTS = ("choose splats", "mesh, slip surface", "cut, particles", "interior splats", "scar, coupling", "trim, check")
FIGURES = ("region_volume_m3", "plan_area_m2", "mean_depth_m", "maximum_depth_m", "volume_rescaling_percent",
           "standing_share", "observed_share", "interpolated_share", "extrapolated_share", "splat_spacing_m",
           "particles")  # fmt: skip


def fill(survey: Survey, splats: SplatCloud, problem: FillingProblem, **options: Any) -> tuple[Filling, Context, list]:
    """Return the filling, its figures, and the seconds that each part took."""
    marks: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as scratch:
        context = Context(
            device=Device(),
            scratch=Path(scratch),
            on_progress=lambda done, total, figures: marks.append((time.perf_counter(), time.process_time())),
        )
        filling = PoissonFiller(**options).fill(survey, splats, problem, context)
    return filling, context, np.diff(np.array(marks), axis=0)


def scene(run: Path, modes: list[str], every: int) -> None:
    config = RunConfig.model_validate(tomllib.loads((run / "run.toml").read_text()))
    keys, store = json.loads((run / "result.json").read_text())["keys"], Store(run.parent / "store")
    survey = store.entry("pose_source", keys["pose_source"]).read(Survey)
    splats = store.entry("reconstructor", keys["reconstructor"]).read(SplatCloud)
    base = likeness(survey, [splats], every)
    count = len(range(0, len(survey.photographs), every))
    print(f"{run.name}: {len(splats)} splats, {count} photographs of {WIDTH} px", flush=True)
    print(f"scan alone: {base:.3f} dB")
    for mode in modes:
        options = {"color_neighbours": 1} if mode == "paper" else {}
        filling, context, seconds = fill(survey, splats, config.filling_problem, mode=mode, **options)
        shown = likeness(survey, [splats, filling.interior, filling.scar], every)
        hidden = likeness(survey, [at_rest(splats, filling)], every)
        print(
            f"{mode}: all inferred splats drawn {shown - base:+.3f} dB, as in the film {hidden - base:+.4f} dB; ",
            end="",
        )
        print(f"{seconds[:, 0].sum():.1f} s wall, {seconds[:, 1].sum():.1f} s CPU")
    print("; ".join(f"{name} {context.figures[name]:.5g}" for name in FIGURES))
    if config.reference_ground is not None:
        compare_with_reference(filling, context, config, survey)


def compare_with_reference(filling: Filling, context: Context, config: RunConfig, survey: Survey) -> None:
    """Print how far the surface is from the reference ground inside the region, as `slideframe run` reports it."""
    plan = plan_of(config.region, survey.georeference)
    figures = compare_surface(filling, plan, config.reference_ground, survey.georeference).figures(
        context.figures["splat_spacing_m"]
    )
    print("surface against reference: " + "; ".join(f"{name} {value:.4f}" for name, value in figures.items()))


def at_rest(splats: SplatCloud, filling: Filling) -> SplatCloud:
    """Return what the film shows before anything moves."""
    count = len(filling.particle_positions)
    frame = ParticleFrame(
        time=0.0,
        positions=filling.particle_positions,
        velocities=np.zeros((count, 3), np.float32),
        deformation_gradients=np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
    )
    moved = Coupling(splats, filling).at(frame)
    return SplatCloud(**{name: np.asarray(getattr(moved, name)) for name in SplatCloud.array_fields()})


def likeness(survey: Survey, clouds: list[SplatCloud], every: int) -> float:
    """Return the mean peak signal-to-noise ratio over every N-th photograph, dB."""
    most = max(cloud.harmonics.shape[1] for cloud in clouds)
    fields = [
        np.concatenate([getattr(cloud, name) for cloud in clouds])
        for name in ("centers", "rotations", "scales", "opacities")
    ]
    fields.append(
        np.concatenate([np.pad(c.harmonics, ((0, 0), (0, most - c.harmonics.shape[1]), (0, 0))) for c in clouds])
    )
    tensors = [torch.from_numpy(field) for field in fields]
    ratios = []
    for index in range(0, len(survey.photographs), every):
        pixels, camera, mask = load_photograph(survey, index, width=WIDTH)
        pose = survey.world_from_camera[index]
        with torch.no_grad():
            raster = rasterize(*tensors, camera=camera, world_from_camera=pose, background=BACKGROUND)
        drawn = raster.colour.clamp(0, 1).numpy()
        square = (drawn - pixels / 255.0) ** 2
        ratios.append(-10 * np.log10(square[mask].mean() if mask is not None else square.mean()))
    return float(np.mean(ratios))


def hillside(splat_count: int) -> tuple[Survey, SplatCloud]:
    """Return a rough slope of about N splats over 100 m by 100 m, and cameras that look down on it."""
    random, side = np.random.default_rng(0), round(splat_count**0.5)
    axis = np.linspace(-50, 50, side)
    x, y = (grid.ravel() + random.uniform(-0.3, 0.3, side * side) * 100 / side for grid in np.meshgrid(axis, axis))
    z = 0.4 * y + 2 * np.sin(x / 6) * np.cos(y / 8) + 0.4 * np.sin(x) * np.cos(1.3 * y)
    count = len(x)
    splats = SplatCloud(
        centers=np.column_stack([x, y, z]).astype(np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales=np.full((count, 3), 60 / side, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        harmonics=random.normal(0, 0.3, (count, 1, 3)).astype(np.float32),
    )
    places = np.array([[east, north, 60.0] for east in (-30, 0, 30) for north in (-30, 0, 30)])
    down = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    survey = Survey(
        georeference=Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=0.0),
        cameras=(Camera(width=1200, height=900, focal_x=840, focal_y=840, principal_x=600, principal_y=450),),
        photographs=tuple(Photograph(path=Path(f"{i}.jpg"), camera=0, sha256="0" * 64) for i in range(len(places))),
        world_from_camera=np.stack([np.column_stack([down, place]) for place in places]),
        position_sigma=np.full((len(places), 3), 0.02),
        sparse_points=np.zeros((0, 3), np.float32),
        sparse_colors=np.zeros((0, 3), np.uint8),
        sparse_errors=np.zeros(0, np.float32),
    )
    return survey, splats


def one(splat_count: int, particle_count: int) -> None:
    """Fill once and print seconds of each part and the peak memory as JSON."""
    survey, splats = hillside(splat_count)
    box = {"x_min": -25.0, "x_max": 25.0, "y_min": -25.0, "y_max": 25.0}
    spacing = (50 * 50 * 30.0 / particle_count) ** (1 / 3)
    problem = FillingProblem(region=BoxRegion(**box, z_min=-30.0), particle_spacing=spacing)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    filling, _, seconds = fill(survey, splats, problem)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = {"wall": seconds[:, 0].tolist(), "cpu": seconds[:, 1].tolist(), "particles": len(filling.particle_volumes)}
    print(json.dumps(result | {"gigabytes": peak * 1024 / 1e9, "before": before * 1024 / 1e9}))


def scaling(splat_counts: list[int], particle_counts: list[int]) -> None:
    print(f"{'splats':>9} {'particles':>10} {'wall s':>8} {'CPU s':>7} {'GB':>5}  share of CPU: {', '.join(PARTS)}")
    for name, sizes, other in (("splats", splat_counts, 100_000), ("particles", particle_counts, 100_000)):
        times, memory = [], []
        for size in sizes:
            counts = [size, other] if name == "splats" else [other, size]
            done = subprocess.run(
                [sys.executable, __file__, "one", *map(str, counts)], capture_output=True, text=True, check=True
            )
            result = json.loads(done.stdout.splitlines()[-1])
            total = sum(result["cpu"])
            times.append(total)
            memory.append(result["gigabytes"])
            shares = " ".join(f"{part / total:4.0%}" for part in result["cpu"])
            line = f"{counts[0]:9d} {result['particles']:10d} {sum(result['wall']):8.1f} {total:7.1f} {memory[-1]:5.2f}"
            print(f"{line}  {shares}", flush=True)
        if len(sizes) > 1:
            slope = np.polyfit(np.log(sizes), np.log(times), 1)[0]
            last = np.log(times[-1] / times[-2]) / np.log(sizes[-1] / sizes[-2])
            print(f"CPU time grows as {name}^{slope:.2f}, between the last two as {name}^{last:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    of_scene = commands.add_parser("scene")
    of_scene.add_argument("run", type=Path)
    of_scene.add_argument("--modes", nargs="+", default=["engineering", "paper"])
    of_scene.add_argument(
        "--every", type=int, default=1, help="take every N-th photograph: large splats are slow to draw"
    )
    of_scaling = commands.add_parser("scaling")
    of_scaling.add_argument("--splats", type=int, nargs="*", default=[10_000, 100_000, 1_000_000, 5_000_000])
    of_scaling.add_argument("--particles", type=int, nargs="*", default=[100_000, 1_000_000, 10_000_000])
    of_one = commands.add_parser("one")
    of_one.add_argument("counts", type=int, nargs=2)
    arguments = parser.parse_args()
    if arguments.command == "one":
        return one(*arguments.counts)
    print_machine("slideframe", "slideframe-fill-poisson", "open3d", "manifold3d")
    if arguments.command == "scene":
        return scene(arguments.run, arguments.modes, arguments.every)
    return scaling(arguments.splats, arguments.particles)


if __name__ == "__main__":
    main()
