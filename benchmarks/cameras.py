"""How long cameras take: features, matching and adjustment, and what the cache of features and matches saves.

    python benchmarks/cameras.py [--photographs FOLDER] [--width PX]

Without a folder the embedded demo's 32 photographs are written and used. Steps are timed inside one run of the stage,
as wall and CPU seconds; then the same survey is located again with what the first run left on the shelf, and once
more without the features of one photograph and all matches.
"""

import argparse
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from machine import print_machine

from slideframe.demo import write_demo_survey
from slideframe.device import Device
from slideframe.problem import Site
from slideframe.stages import Context
from slideframe_pose_rtk import correspondences, solution
from slideframe_pose_rtk.source import RtkPoses

# Each step by the function that does it, and the module that calls it.
STEPS = (
    ("features", correspondences, "find_features"),
    ("matching", correspondences, "match_photographs"),
    ("headings", correspondences, "heading_offsets"),
    ("triangulation", correspondences, "triangulate"),
    ("adjustment", solution, "adjust"),
)

Times = dict[str, list[float]]


@contextmanager
def timed_steps() -> Iterator[Times]:
    """Add up wall and CPU seconds of each step."""
    times: Times = {name: [0.0, 0.0] for name, _, _ in STEPS}
    originals = [(module, function, getattr(module, function)) for _, module, function in STEPS]

    def timed(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **named: Any) -> Any:
            wall, cpu = time.perf_counter(), time.process_time()
            try:
                return work(*arguments, **named)
            finally:
                times[name][0] += time.perf_counter() - wall
                times[name][1] += time.process_time() - cpu

        return run

    for (name, _, _), (module, function, work) in zip(STEPS, originals, strict=True):
        setattr(module, function, timed(name, work))
    try:
        yield times
    finally:
        for module, function, work in originals:
            setattr(module, function, work)


def locate(photographs: Path, cache: Path) -> tuple[Times, int]:
    """Locate the cameras once; return the times of the steps, of all, and how many photographs were registered."""
    with tempfile.TemporaryDirectory() as scratch, timed_steps() as times:
        context = Context(device=Device(), scratch=Path(scratch), cache=cache)
        wall, cpu = time.perf_counter(), time.process_time()
        survey = RtkPoses().locate(Site(photographs=photographs), context)
        whole = [time.perf_counter() - wall, time.process_time() - cpu]
    return times | {"all": whole}, len(survey.photographs)


def print_times(title: str, times: Times, count: int) -> None:
    print(f"\n{title}")
    for name, (wall, cpu) in times.items():
        print(f"{name:<14}{wall:>8.1f} s{cpu:>8.1f} CPU-s{1e3 * cpu / count:>9.0f} CPU-ms a photograph")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photographs", type=Path)
    parser.add_argument("--width", type=int, default=1200)
    options = parser.parse_args()
    print_machine("slideframe-pose-rtk", "pycolmap", "numpy", "pillow")
    with tempfile.TemporaryDirectory() as folder:
        photographs = options.photographs
        if photographs is None:
            write_demo_survey(Path(folder) / "survey", width=options.width)
            photographs = Path(folder) / "survey" / "photographs"
        count = sum(path.suffix.lower() in (".jpg", ".jpeg") for path in photographs.iterdir())
        cache = Path(folder) / "cache"
        first, registered = locate(photographs, cache)
        print_times(f"{count} photographs, {registered} registered", first, count)
        again, _ = locate(photographs, cache)
        print_times("the same with the shelf full", again, count)
        newest = sorted((cache / "features").iterdir())[0]
        newest.unlink()
        shutil.rmtree(cache / "matches")
        added, _ = locate(photographs, cache)
        print_times("one photograph and all matches missing from the shelf", added, count)
        print(f"\nCPU of all: {first['all'][1] / again['all'][1]:.1f} times as much without the shelf")
        print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


if __name__ == "__main__":
    main()
