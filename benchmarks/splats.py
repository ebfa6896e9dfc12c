"""How fast splats are drawn and differentiated on the CPU, after showing that both backends do it alike.

    python benchmarks/splats.py [--splats N] [--repeats N]

`numba` is compiled; `torch` is the reference, which weighs every splat at every pixel. Its gradient keeps about 30
bytes for each such pair, so both directions are compared with a tenth of the splats. The backends take turns, so that
a busy moment harms both alike, and compile beforehand.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch

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


def timed(work: Callable[..., object], *arguments: object) -> tuple[float, float]:
    """Return wall and CPU milliseconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    work(*arguments)
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)


def print_heading() -> None:
    print(f"{'milliseconds':<32}{'best':>10}{'median':>10}{'CPU':>10}{'speed-up':>10}{'CPU':>8}")


def print_times(
    what: str, work: Callable[..., object], splats: Splats, camera: Camera, backends: Sequence[str], repeats: int
) -> None:
    """Print the milliseconds of each backend, and the ratio of the first one's medians to its own."""
    samples = [[timed(work, splats, camera, backend) for backend in backends] for _ in range(repeats)]
    best = np.min(samples, axis=0)[:, 0]
    medians = np.median(samples, axis=0)
    for backend, shortest, (wall, cpu) in zip(backends, best, medians, strict=True):
        ratios = medians[0] / (wall, cpu)
        print(f"{what:<24}{backend:<8}{shortest:>10.1f}{wall:>10.1f}{cpu:>10.1f}{ratios[0]:>10.1f}{ratios[1]:>8.1f}")


def print_machine(*packages: str) -> None:
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    processor = names[0].partition(": ")[2] if names else platform.processor()
    print(f"{processor}, {len(os.sched_getaffinity(0))} cores; Python {platform.python_version()}, ", end="")
    print(", ".join(f"{package} {version(package)}" for package in packages))


def check_picture(splats: Splats, camera: Camera) -> None:
    found = psnr(*(forward(splats, camera, backend) for backend in ("numba", "torch")))
    print(f"{len(splats[0]):,} splats: the pictures agree to {found:.1f} dB PSNR")
    if found < LEAST_PSNR_DB:
        raise SystemExit(f"that is less than {LEAST_PSNR_DB:g} dB: times mean nothing")


def check_gradients(splats: Splats, camera: Camera) -> None:
    mine, theirs = (forward_and_backward(splats, camera, backend) for backend in ("numba", "torch"))
    errors = [float((one - other).norm() / other.norm()) for one, other in zip(mine, theirs, strict=True)]
    worst = max(errors)
    print(
        f"{len(splats[0]):,} splats: the largest relative gradient difference is {worst:.1e}, {NAMES[errors.index(worst)]}"
    )
    if not worst <= GRADIENT_TOLERANCE:
        raise SystemExit(f"that is more than {GRADIENT_TOLERANCE:g}: times mean nothing")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splats", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    print_machine("slideframe-gs-torch", "torch", "numba", "numpy")

    small, large = camera_of(320, 240), camera_of(640, 480)
    many, few = random_splats(options.splats), random_splats(options.splats // 10)
    print("\n320 x 240 px, numba against torch")
    check_picture(many, small)
    check_picture(few, small)
    check_gradients(few, small)

    print_heading()
    cases = (("forward", forward, many), ("forward", forward, few), ("both ways", forward_and_backward, few))
    for what, work, splats in cases:
        print_times(f"{len(splats[0]):,} {what}", work, splats, small, ("torch", "numba"), options.repeats)

    many = random_splats(50_000)
    print("\n640 x 480 px, numba alone")
    print_heading()
    for what, work in (("forward", forward), ("both ways", forward_and_backward)):
        print_times(f"{len(many[0]):,} {what}", work, many, large, ("numba",), 10 * options.repeats)


if __name__ == "__main__":
    main()
