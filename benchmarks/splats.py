"""How fast splats are drawn and differentiated on the CPU, after showing that both backends do it alike.

    python benchmarks/splats.py [--splats N] [--repeats N]

`numba` is compiled; `torch` is the reference, which weighs every splat at every pixel. Its gradient keeps about 30
bytes for each such pair, so gradients are compared with a twentieth of the splats. `torch` needs most of a minute, so
it is timed once; `numba` is compiled before, and timed before and after it; the two medians are averaged.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from machine import print_machine

from slideframe.products import Camera
from slideframe_gs_torch.rasterize import rasterize

NAMES = ("centers", "rotations", "scales", "opacities", "colours")
POSE = np.column_stack([np.eye(3), np.zeros(3)])
# The kernels' exponential is a polynomial in float32: 60 dB is a thousandth of full scale.
LEAST_PSNR_DB = 60.0
# Of the norm, tensor by tensor: float32 sums of some thousand terms on both sides.
GRADIENT_TOLERANCE = 1e-3

Splats = list[torch.Tensor]


def random_splats(count: int, seed: int = 0) -> Splats:
    """Return splats 2 to 8 m before the camera, all over its picture, some pixels wide, with float32 parameters."""
    random = np.random.default_rng(seed)
    depth = random.uniform(2, 8, count)
    arrays = [
        np.column_stack([random.uniform(-0.6, 0.6, count) * depth, random.uniform(-0.45, 0.45, count) * depth, depth]),
        random.normal(size=(count, 4)),
        np.exp(random.normal(-3.7, 0.5, (count, 3))),
        random.uniform(0.05, 0.98, count),
        random.uniform(0, 1, (count, 3)),
    ]
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


def camera_of(width: int, height: int) -> Camera:
    return Camera(
        width=width,
        height=height,
        focal_x=0.9 * width,
        focal_y=0.9 * width,
        principal_x=width / 2,
        principal_y=height / 2,
    )


def forward(splats: Splats, camera: Camera, backend: str) -> torch.Tensor:
    with torch.no_grad():
        return rasterize(*splats, camera=camera, world_from_camera=POSE, backend=backend).colour


def forward_and_backward(splats: Splats, camera: Camera, backend: str) -> Splats:
    """Return the gradients of a sum of colours with random weights of either sign."""
    leaves = [tensor.clone().requires_grad_() for tensor in splats]
    colour = rasterize(*leaves, camera=camera, world_from_camera=POSE, backend=backend).colour
    weights = torch.randn(colour.shape, generator=torch.Generator().manual_seed(7))
    colour.backward(weights)
    return [leaf.grad for leaf in leaves]


def psnr(mine: torch.Tensor, theirs: torch.Tensor) -> float:
    return float(-10 * torch.log10((mine - theirs).double().square().mean()))


@dataclass(frozen=True)
class Timing:
    """Wall and CPU milliseconds, medians, of work done some times, and what it gave."""

    result: Any
    wall: float
    cpu: float


def measure(work: Callable[..., Any], splats: Splats, camera: Camera, backend: str, repeats: int) -> Timing:
    samples = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        result = work(splats, camera, backend)
        samples.append((time.perf_counter() - wall, time.process_time() - cpu))
    return Timing(result, *(1e3 * np.median(samples, axis=0)))


def check_picture(mine: torch.Tensor, theirs: torch.Tensor) -> None:
    found = psnr(mine, theirs)
    print(f"pictures agree to {found:.1f} dB PSNR")
    if not found >= LEAST_PSNR_DB:
        raise SystemExit(f"that is less than {LEAST_PSNR_DB:g} dB: times mean nothing")


def check_gradients(mine: Splats, theirs: Splats) -> None:
    errors = [float((one - other).norm() / other.norm()) for one, other in zip(mine, theirs, strict=True)]
    worst = max(errors)
    print(f"largest relative difference of a gradient {worst:.1e}, that of {NAMES[errors.index(worst)]}")
    if not worst <= GRADIENT_TOLERANCE:
        raise SystemExit(f"that is more than {GRADIENT_TOLERANCE:g}: times mean nothing")


def compare(work: Callable[..., Any], check: Callable[..., None], splats: Splats, camera: Camera, repeats: int) -> None:
    """Show that the backends agree, then their times."""
    work(splats, camera, "numba")  # compiles
    print(f"\n{work.__name__}, {len(splats[0]):,} splats, {camera.width} x {camera.height} px: ", end="", flush=True)
    numba = [measure(work, splats, camera, "numba", repeats)]
    reference = measure(work, splats, camera, "torch", 1)
    numba.append(measure(work, splats, camera, "numba", repeats))
    check(numba[0].result, reference.result)
    wall, cpu = (float(np.mean([getattr(timing, name) for timing in numba])) for name in ("wall", "cpu"))
    print(f"numba {wall:.1f} ms ({cpu:.1f} CPU), torch {reference.wall:,.0f} ms ({reference.cpu:,.0f} CPU), ", end="")
    print(f"ratio {reference.wall / wall:,.0f} ({reference.cpu / cpu:,.0f} CPU)", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splats", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=20)
    options = parser.parse_args()
    print_machine("slideframe-gs-torch", "torch", "numba", "numpy")
    small, large = camera_of(320, 240), camera_of(640, 480)
    compare(forward, check_picture, random_splats(options.splats), small, options.repeats)
    compare(forward_and_backward, check_gradients, random_splats(options.splats // 20), small, options.repeats)

    many = random_splats(50_000)
    print(f"\nnumba alone, {len(many[0]):,} splats, {large.width} x {large.height} px")
    for work in (forward, forward_and_backward):
        timing = measure(work, many, large, "numba", options.repeats)
        print(f"{work.__name__:<22}{timing.wall:>8.1f} ms{timing.cpu:>8.1f} CPU-ms")


if __name__ == "__main__":
    main()
