"""The demo's cameras against the truth, with sound and with faulty metadata, and how long each step takes.

    python benchmarks/cameras.py [--survey FOLDER] [--no-faults]

FOLDER is what `slideframe demo-survey` writes; without, it is written anew, 32 photographs of 1200 px. Steps are timed
inside one run of the stage, as wall and CPU seconds; then the same survey is located again with what the first run
left on the shelf. Each fault is put into the positions (a table, as users give one) or into copies of the files. See
survey.py for how the steps grow with the number of photographs.
"""

import argparse
import json
import re
import resource
import shutil
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from machine import print_machine

from slideframe.demo import write_demo_survey
from slideframe.device import Device
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.problem import Site
from slideframe.products import Georeference, Survey
from slideframe.stages import Context
from slideframe_pose_rtk import correspondences, solution
from slideframe_pose_rtk.orientation import angle_between
from slideframe_pose_rtk.reading import read_record
from slideframe_pose_rtk.source import RtkPoses

# Each step by the function that does it, and the module that calls it.
STEPS = (
    ("features", correspondences, "find_features"),
    ("matching", correspondences, "match_photographs"),
    ("headings", correspondences, "heading_offsets"),
    ("triangulation", correspondences, "triangulate"),
    ("adjustment", solution, "adjust"),
)
SECOND_FLIGHT = 16  # its first photograph
HEAD = f"{'':<27}registered  centres, cm rms E / N / U, and at worst   degrees: median, worst   reprojection, px"

Times = dict[str, list[float]]
Positions = tuple[np.ndarray, np.ndarray, list[str]]  # (photograph, 3) m, sigmas, fixes


@dataclass(frozen=True)
class Truth:
    """The demo's own cameras, and what its photographs state."""

    folder: Path
    origin: Georeference
    poses: dict[str, np.ndarray]

    @classmethod
    def read(cls, survey: Path) -> "Truth":
        cameras = json.loads((survey / "ground_truth" / "cameras.json").read_text())
        poses = {name: np.array(pose) for name, pose in cameras["world_from_camera"].items()}
        return cls(survey / "photographs", Georeference(**cameras["origin"]), poses)

    def stated(self) -> Positions:
        records = [read_record(path) for path in sorted(self.folder.iterdir())]
        geodetic = np.array([(record.latitude, record.longitude, record.height) for record in records])
        sigma = np.array([record.position_sigma for record in records])
        return enu_from_geodetic(geodetic, self.origin), sigma, ["fixed"] * len(records)

    def errors(self, survey: Survey) -> tuple[np.ndarray, np.ndarray]:
        """Return centres' errors (photograph, 3), m, and angles, degrees."""
        poses = np.array([self.poses[photograph.name] for photograph in survey.photographs])
        offset = survey.world_from_camera[:, :, 3] - poses[:, :, 3]
        return offset, angle_between(survey.world_from_camera[:, :, :3], poses[:, :, :3])


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


def locate(photographs: Path, cache: Path, **options: Any) -> tuple[Times, Survey, Context]:
    """Locate the cameras once; return the times of the steps and of all, and what came out."""
    with tempfile.TemporaryDirectory() as scratch, timed_steps() as times:
        context = Context(device=Device(), scratch=Path(scratch), cache=cache)
        wall, cpu = time.perf_counter(), time.process_time()
        survey = RtkPoses(**options).locate(Site(photographs=photographs), context)
        whole = [time.perf_counter() - wall, time.process_time() - cpu]
    return times | {"all": whole}, survey, context


def print_times(title: str, times: Times, count: int) -> None:
    print(f"\n{title}")
    for name, (wall, cpu) in times.items():
        print(f"{name:<14}{wall:>8.1f} s{cpu:>8.1f} CPU-s{1e3 * cpu / count:>9.0f} CPU-ms a photograph")


def print_accuracy(title: str, truth: Truth, survey: Survey, context: Context) -> None:
    """Print one line of numbers, and what the survey says of itself."""
    offset, angles = truth.errors(survey)
    rms = " / ".join(f"{100 * value:.1f}" for value in np.sqrt(np.mean(offset**2, axis=0)))
    print(
        f"{title:<27}{len(survey.photographs):>10}{rms:>29}{100 * np.abs(offset).max():>11.1f}"
        f"{np.median(angles):>18.3f}{angles.max():>8.3f}{context.figures['reprojection_error_px']:>19.3f}",
        flush=True,
    )
    for warning in context.warnings:
        print("    " + textwrap.shorten(warning, 146, placeholder=" ..."))


def write_table(path: Path, truth: Truth, positions: Positions) -> Path:
    places, sigma, fixes = positions
    lines = ["name,latitude,longitude,ellipsoidal_height,sigma_east,sigma_north,sigma_up,fix"]
    geodetic = geodetic_from_enu(places, truth.origin)
    for file, place, deviation, fix in zip(sorted(truth.folder.iterdir()), geodetic, sigma, fixes, strict=True):
        latitude, longitude, height = place
        lines.append(f"{file.name},{latitude:.10f},{longitude:.10f},{height:.4f},{','.join(map(str, deviation))},{fix}")
    path.write_text("\n".join(lines))
    return path


def faulty_positions(truth: Truth) -> Iterator[tuple[str, Positions]]:
    """Yield what positions may be like."""
    random = np.random.default_rng(3)
    places, sigma, fixed = truth.stated()
    true = np.array([truth.poses[path.name][:, 3] for path in sorted(truth.folder.iterdir())])
    count = len(places)
    yield "noise of ten times sigma", (true + random.normal(0, 10 * sigma), sigma, fixed)
    false = places.copy()
    false[[3, 12, 25]] += [[6.0, -4.0, 0.0], [0.0, 0.0, 1.5], [0.5, 0.5, 0.0]]
    yield "three outliers", (false, sigma, fixed)
    mixed, doubt = places.copy(), sigma.copy()
    mixed[1::2] = true[1::2] + random.normal(0, 0.5, (count // 2, 3))
    doubt[1::2] = 0.5
    yield "every other one float", (mixed, doubt, ["fixed", "float"] * (count // 2))
    yield "all float", (true + random.normal(0, 0.5, true.shape), np.full((count, 3), 0.5), ["float"] * count)
    loose = np.full((count, 3), [5.0, 5.0, 8.0])
    yield "no RTK, 5 m", (true + random.normal(0, loose), loose, ["none"] * count)


def turn_second_flight(truth: Truth, folder: Path) -> Path:
    """Copy the photographs; the second half is taken an hour later, by a compass that is 180 degrees off."""
    shutil.copytree(truth.folder, folder)
    for path in sorted(folder.iterdir())[SECOND_FLIGHT:]:
        data = path.read_bytes()
        data = re.sub(rb'UTCAtExposure="([^"T]*)T02', rb'UTCAtExposure="\1T03', data)
        path.write_bytes(re.sub(rb'GimbalYawDegree="([^"]*)"', _turned_yaw, data))
    return folder


def _turned_yaw(match: "re.Match[bytes]") -> bytes:
    """Return the attribute with the yaw turned, of the same length, which its segment states."""
    yaw = (float(match[1]) + 360.0) % 360.0 - 180.0
    return b'GimbalYawDegree="' + f"{yaw:+.2f}".ljust(len(match[1])).encode()[: len(match[1])] + b'"'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--survey", type=Path)
    parser.add_argument("--no-faults", action="store_true")
    options = parser.parse_args()
    print_machine("slideframe-pose-rtk", "pycolmap", "numpy", "pillow")
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        if options.survey is None:
            write_demo_survey(work / "survey")
        truth = Truth.read(options.survey or work / "survey")
        count, cache = len(truth.poses), work / "cache"
        first, survey, context = locate(truth.folder, cache, origin=truth.origin)
        print_times(f"{count} photographs of {survey.cameras[0].width} px", first, count)
        again, _, _ = locate(truth.folder, cache, origin=truth.origin)
        print_times("the same with the shelf full", again, count)
        print(f"\nCPU of all: {first['all'][1] / again['all'][1]:.1f} times as much without the shelf")
        print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB\n")
        print(HEAD)
        print_accuracy("as written", truth, survey, context)
        if not options.no_faults:
            print_faults(truth, work, cache)


def print_faults(truth: Truth, work: Path, cache: Path) -> None:
    for name, positions in faulty_positions(truth):
        table = write_table(work / "positions.csv", truth, positions)
        print_accuracy(name, truth, *locate(truth.folder, cache, origin=truth.origin, positions=table)[1:])
    folder = turn_second_flight(truth, work / "turned")
    print_accuracy("second flight 180 degrees", truth, *locate(folder, cache, origin=truth.origin)[1:])


if __name__ == "__main__":
    main()
