"""How fast splats are drawn, differentiated and trained on the CPU, after showing that it is done right.

    python benchmarks/splats.py [--splats N] [--repeats N] [--only SECTION]

Sections: `agreement` with the float64 reference; `torch`, the same pictures and gradients by plain torch, tile by tile;
`iteration`, a whole step of training and its shares, and a render, by number of threads; `growth` in pixels and in
splats; `large`, a million splats at 1920 x 1440 with its peak memory; `assembly`, whether the kernels are vectors.
Wall and CPU milliseconds are the least of the repeats: whatever else the machine does only adds to them.
"""

import argparse
import math
import re
import resource
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import numba
import torch
from machine import print_machine
from splat_scenes import POSE, Splats, camera_of, photograph, random_splats, training_state
from torch_tiles import draw_by_tiles

from slideframe.products import Camera
from slideframe_gs_torch import compiled, compositing_kernels, image_loss, threads, training
from slideframe_gs_torch.densification.budgeted_splits import BudgetedSplits, Schedule, densify
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.reconstructor import TorchSplats

# The kernels' exponential is a polynomial in float32: 60 dB is a thousandth of full scale.
LEAST_PSNR_DB = 60.0
# Of the norm, tensor by tensor: float32 sums of some thousand terms.
GRADIENT_TOLERANCE = 1e-4
# Splats in the reference's gradient, which keeps about 60 bytes for each pixel and splat.
REFERENCE_SPLATS = 1000
# Which share of an iteration a kernel belongs to.
SHARES = {
    "project": "projection and harmonics",
    "paint": "projection and harmonics",
    "project_backward": "projection and harmonics",
    "paint_backward": "projection and harmonics",
    "composite": "forward",
    "composite_backward": "backward",
}


class Cost(NamedTuple):
    """Wall and CPU milliseconds."""

    wall: float
    cpu: float

    def __str__(self) -> str:
        return f"{self.wall:9.1f} ms {self.cpu:9.1f} CPU-ms"


def least_cost(work: Callable[[], Any], repeats: int) -> Cost:
    """Do the work once to compile it, then some times."""
    work()
    samples = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        samples.append((1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)))
    return Cost(*(min(column) for column in zip(*samples, strict=True)))


@contextmanager
def thread_number(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    with patch.object(threads, "thread_count", lambda: count):
        yield
    torch.set_num_threads(before)


def draw(splats: Splats, camera: Camera, backend: str = "numba") -> torch.Tensor:
    return rasterize(*splats, camera=camera, world_from_camera=POSE, backend=backend).colour


def forward(splats: Splats, draw: Callable[[Splats], torch.Tensor]) -> torch.Tensor:
    with torch.no_grad():
        return draw(splats)


def forward_and_backward(splats: Splats, draw: Callable[[Splats], torch.Tensor]) -> Splats:
    """Return the gradients of a sum of colours with random weights of either sign."""
    leaves = [tensor.clone().requires_grad_() for tensor in splats]
    colour = draw(leaves)
    weights = torch.randn(colour.shape, generator=torch.Generator().manual_seed(7))
    colour.backward(weights.to(colour.dtype))
    return [leaf.grad for leaf in leaves]


def require(found: float, limit: float, what: str) -> None:
    print(f"{what}: {found:.3g}")
    if not found <= limit:
        raise SystemExit(f"that is more than {limit:g}: times mean nothing")


def agreement(options: argparse.Namespace) -> None:
    """The compiled kernels against the float64 reference, picture and gradients."""
    camera, splats = camera_of(320, 240), random_splats(REFERENCE_SPLATS)
    exact = [tensor.double() for tensor in splats]
    mine, theirs = forward(splats, lambda s: draw(s, camera)), forward(exact, lambda s: draw(s, camera, "torch"))
    error = float((mine - theirs).square().mean())
    print(f"PSNR of the picture: {-10 * math.log10(error):.0f} dB")
    require(error, 10 ** (-LEAST_PSNR_DB / 10), "its mean square error")
    mine = forward_and_backward(splats, lambda s: draw(s, camera))
    theirs = forward_and_backward(exact, lambda s: draw(s, camera, "torch"))
    worst = max(float((one - other).norm() / other.norm()) for one, other in zip(mine, theirs, strict=True))
    require(worst, GRADIENT_TOLERANCE, "largest relative error of a gradient")


def against_torch(options: argparse.Namespace) -> None:
    """Plain torch, once since it has nothing to compile, between the kernels before and after it; on one thread each.

    On a busy machine torch's own threads would wait for one another by spinning, many times longer than they work.
    """
    with thread_number(1):
        _against_torch(options)


def _against_torch(options: argparse.Namespace) -> None:
    camera, splats = camera_of(640, 480), random_splats(options.splats)
    for work, limit in ((forward, 10 ** (-LEAST_PSNR_DB / 20)), (forward_and_backward, 1e-3)):
        mine = [least_cost(lambda work=work: work(splats, lambda s: draw(s, camera)), options.repeats)]
        wall, cpu = time.perf_counter(), time.process_time()
        theirs = work(splats, lambda s: draw_by_tiles(*s, camera))
        torch_cost = Cost(1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu))
        mine.append(least_cost(lambda work=work: work(splats, lambda s: draw(s, camera)), options.repeats))
        found = work(splats, lambda s: draw(s, camera))
        pairs = zip(found, theirs, strict=True) if work is forward_and_backward else [(found, theirs)]
        require(max(float((one - other).norm() / other.norm()) for one, other in pairs), limit, "largest difference")
        cost = min(mine)
        print(f"{work.__name__:<24} numba {cost}\n{'':<24} torch {torch_cost}")
        print(
            f"{'':<24} ratio {torch_cost.wall / cost.wall:.0f}, of CPU time {torch_cost.cpu / cost.cpu:.0f}", flush=True
        )


@contextmanager
def stopwatches() -> Iterator[dict[str, float]]:
    """Add the CPU seconds of each share of an iteration to what is yielded."""
    seconds: dict[str, float] = defaultdict(float)
    share_out = compiled.run_shares

    def timed(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def clocked(*arguments: Any) -> Any:
            began = time.process_time()
            result = work(*arguments)
            seconds[name] += time.process_time() - began
            return result

        return clocked

    def by_kernel(kernel: Any, *arguments: Any) -> None:
        share = SHARES.get(kernel.__name__)
        (timed(share, share_out) if share else share_out)(kernel, *arguments)

    with (
        patch.object(compiled, "run_shares", by_kernel),
        patch.object(compiled, "list_tiles", timed("binning", compiled.list_tiles)),
        patch.object(image_loss, "_measure", timed("loss", image_loss._measure)),
        patch.object(Adam, "step", lambda self, *a, step=Adam.step: timed("optimiser", step)(self, *a)),
    ):
        yield seconds


def iteration(options: argparse.Namespace) -> None:
    """A step of training, its shares, what densification adds to it, and a render."""
    camera, tuning = camera_of(640, 480), TorchSplats()
    splats, view = random_splats(options.splats), photograph(camera)
    state = training_state(splats, iteration=tuning.iterations // 2)
    growth = BudgetedSplits(tuning.iterations, options.splats, tuning.splat_budget)

    def step() -> None:
        training.descend(tuning, view, (0.5, 0.5, 0.5), state, growth, 8.0)

    for count in (1, 2):
        with thread_number(count), threads.one_torch_thread():
            cost = least_cost(step, options.repeats)
            shares = least_shares(step, options.repeats)
            render = least_cost(lambda: forward(splats, lambda s: draw(s, camera)), options.repeats)
        print(f"\n{count} thread{'s' if count > 1 else ''}: iteration {cost}; render {render}")
        shares["rest (autograd, torch)"] = max(cost.cpu - sum(shares.values()), 0)
        shares["densification"] = densification_cost(splats, tuning)
        for name, cpu in shares.items():
            print(f"    {name:<26}{cpu:7.2f} CPU-ms {100 * cpu / (cost.cpu + shares['densification']):5.1f} %")


def least_shares(step: Callable[[], None], repeats: int) -> dict[str, float]:
    """Return the least CPU milliseconds of each share of a step."""
    found: dict[str, list[float]] = defaultdict(list)
    for _ in range(repeats):
        with stopwatches() as seconds:
            step()
        for name, spent in seconds.items():
            found[name].append(1e3 * spent)
    return {name: min(spent) for name, spent in found.items()}


def densification_cost(splats: Splats, tuning: TorchSplats) -> float:
    """CPU milliseconds of a round that adds a tenth of the splats, spread over the iterations between two rounds."""
    interval = Schedule(tuning.iterations, len(splats[0]), tuning.splat_budget).interval
    scores = torch.rand(len(splats[0]), generator=torch.Generator().manual_seed(1))

    def round_of() -> float:
        state = training_state(splats)
        began = time.process_time()
        densify(state.parameters, state.adam, scores, len(splats[0]) * 11 // 10)
        return 1e3 * (time.process_time() - began)

    return min(round_of() for _ in range(3)) / interval


def growth(options: argparse.Namespace) -> None:
    """Forward and backward as pixels and splats grow."""
    sizes = [(320, 240), (640, 480), (1280, 960)]
    counts = [options.splats // 4, options.splats, 4 * options.splats]
    for width, height, count in [*((*size, options.splats) for size in sizes), *((640, 480, c) for c in counts)]:
        splats, camera = random_splats(count), camera_of(width, height)
        cost = least_cost(
            lambda splats=splats, camera=camera: forward_and_backward(splats, lambda s: draw(s, camera)),
            max(options.repeats // 3, 2),
        )
        print(f"{count:>9,} splats, {width:>4} x {height:<4} px: {cost}", flush=True)


def large(options: argparse.Namespace) -> None:
    """A million splats, forward and backward, in a process of its own."""
    code = "import splats; splats.large_here()"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=__file__.rpartition("/")[0] or ".")


def large_here() -> None:
    splats, camera = random_splats(1_000_000), camera_of(1920, 1440)
    cost = least_cost(lambda: forward_and_backward(splats, lambda s: draw(s, camera)), 2)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"1,000,000 splats, 1920 x 1440 px, forward and backward: {cost}, peak memory {peak:,.0f} MB")


def assembly(options: argparse.Namespace) -> None:
    """Count the multiplications of the compositing kernels' machine code by the width of their registers."""
    forward_and_backward(random_splats(10), lambda s: draw(s, camera_of(64, 64)))  # fixes their types
    for name in ("composite", "composite_backward"):
        kernel = getattr(compositing_kernels, name)
        fresh = numba.njit(nogil=True, fastmath=True, error_model="numpy")(kernel.py_func)
        fresh.compile(kernel.signatures[0])
        widths: dict[str, int] = defaultdict(int)
        for line in fresh.inspect_asm(kernel.signatures[0]).splitlines():
            if re.match(r"\s+v?f?n?m(ul|add|sub)\w*[ps]s\s", line) or re.match(r"\s+vf\w+ps\s", line):
                widths[re.findall(r"[xyz]mm", line)[-1] + (" packed" if "ps" in line.split()[0] else " scalar")] += 1
        print(f"{name:<20}", ", ".join(f"{width}: {number}" for width, number in sorted(widths.items())))


SECTIONS = {
    "agreement": agreement,
    "torch": against_torch,
    "iteration": iteration,
    "growth": growth,
    "large": large,
    "assembly": assembly,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splats", type=int, default=50_000)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--only", choices=SECTIONS)
    options = parser.parse_args()
    print_machine("slideframe-gs-torch", "torch", "numba", "numpy")
    for name, section in SECTIONS.items():
        if options.only in (None, name):
            print(f"\n{name}: {section.__doc__.splitlines()[0]}", flush=True)
            section(options)


if __name__ == "__main__":
    main()
