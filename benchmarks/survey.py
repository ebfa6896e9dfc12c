"""CPU time per photograph of each step of the pose source, and its memory, on synthetic surveys of growing size.

    python benchmarks/survey.py [--counts 32,200,1000] [--metadata-only]

A survey is a nadir flight over flat noise, 320 x 240 px pictures with 75 and 65 % overlap, whose headers are as long as
a real drone's (a MakerNote of 40 kB). Each survey runs in a process of its own, whose peak memory is stated beside that
of the same process with the backends imported and no survey. Steps that happen inside others are set off with a dot.
CPU time, which other work on the machine changes least; wall time of the whole stands below. See cameras.py for the
demo's survey and what the cache saves.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import print_machine
from PIL import ExifTags, Image

from slideframe.geodesy import geodetic_from_enu
from slideframe.products import Georeference

WIDTH, HEIGHT, FOCAL_LENGTH = 320, 240, 266.7
GROUND_PIXEL = 0.05  # m
STEP_NORTH, STEP_EAST = 60, 112  # px on the ground
ORIGIN = Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=100.0)
MAKER_NOTE = 40_000  # bytes
# What is timed: module, function, and how it's called in the table.
STEPS = (
    ("intake", "admit", "intake, with SHA-256"),
    ("intake", "read_record", "· metadata"),
    ("correspondences", "find_features", "features"),
    ("correspondences", "match_photographs", "matches"),
    ("correspondences", "heading_offsets", "headings"),
    ("correspondences", "write_database", "database"),
    ("correspondences", "triangulate", "triangulation"),
    ("solution", "adjust", "bundle adjustment"),
)


def ground(rows: int, columns: int) -> np.ndarray:
    """Noise on five scales, so that there are features of every size."""
    random = np.random.default_rng(0)
    height, width = STEP_NORTH * rows + HEIGHT, STEP_EAST * columns + WIDTH
    total = np.zeros((height, width), np.float32)
    for size in (2, 4, 8, 16, 32):
        coarse = random.normal(128, 40, (height // size + 2, width // size + 2)).clip(0, 255).astype(np.uint8)
        total += np.asarray(Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC), np.float32)
    return (total / 5).astype(np.uint8)


def write_survey(folder: Path, count: int) -> None:
    columns = max(2, round(np.sqrt(count / 2)))
    rows = -(-count // columns)
    texture = ground(rows, columns)
    random = np.random.default_rng(1)
    for number in range(count):
        column, row = divmod(number, rows)
        row = rows - 1 - row if column % 2 else row  # to and fro
        top, left = STEP_NORTH * row, STEP_EAST * column
        east, north = (left + WIDTH / 2) * GROUND_PIXEL, -(top + HEIGHT / 2) * GROUND_PIXEL
        place = geodetic_from_enu(np.array([[east, north, FOCAL_LENGTH * GROUND_PIXEL]]), ORIGIN)[0]
        exif = Image.Exif()
        exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = "DJI", "M3E"
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.MakerNote] = random.bytes(MAKER_NOTE)
        pixels = texture[top : top + HEIGHT, left : left + WIDTH]
        path = folder / f"DJI_{number:04d}.JPG"
        Image.fromarray(pixels).convert("RGB").save(path, exif=exif, xmp=packet(*place), quality=90)


def packet(latitude: float, longitude: float, height: float) -> bytes:
    values = {
        **{"GpsLatitude": f"{latitude:.9f}", "GpsLongitude": f"{longitude:.9f}", "AbsoluteAltitude": f"{height:.3f}"},
        **{"RelativeAltitude": "20.0", "AltitudeType": "RtkAlt", "RtkFlag": "50"},
        **{"RtkStdLon": "0.01", "RtkStdLat": "0.01", "RtkStdHgt": "0.02"},
        **{"GimbalYawDegree": "0.0", "GimbalPitchDegree": "-90.0", "GimbalRollDegree": "0.0"},
        "DewarpData": f"2024-01-01;{FOCAL_LENGTH},{FOCAL_LENGTH},0,0,0,0,0,0,0",
    }
    attributes = "".join(f' d:{name}="{value}"' for name, value in values.items())
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" xmlns:d="http://www.dji.com/drone-dji/1.0/"{attributes}/>'
        "</rdf:RDF></x:xmpmeta>"
    ).encode()


def timed(function: Callable[..., Any], name: str, seconds: dict[str, float]) -> Callable[..., Any]:
    def call(*arguments: Any, **options: Any) -> Any:
        start = time.process_time()
        try:
            return function(*arguments, **options)
        finally:
            seconds[name] = seconds.get(name, 0.0) + time.process_time() - start

    return call


def run_one(folder: Path, metadata_only: bool) -> dict[str, Any]:
    """Survey one folder in this process and return seconds by step, peak memory and what was found."""
    import pycolmap  # noqa: F401

    from slideframe.device import Device
    from slideframe.problem import Site
    from slideframe.stages import Context
    from slideframe_pose_rtk import correspondences, intake, solution
    from slideframe_pose_rtk.source import RtkPoses

    empty = peak_memory()
    seconds: dict[str, float] = {}
    for module, function, name in STEPS:
        owner = {"intake": intake, "correspondences": correspondences, "solution": solution}[module]
        setattr(owner, function, timed(getattr(owner, function), name, seconds))
    with tempfile.TemporaryDirectory() as scratch:
        context = Context(device=Device(), scratch=Path(scratch))
        wall, start = time.perf_counter(), time.process_time()
        if metadata_only:
            found = {"photographs": len(intake.admit(intake.photograph_files(folder), folder, context)[0])}
        else:
            RtkPoses().locate(Site(photographs=folder), context)
            names = ("registered_photographs", "sparse_points", "reprojection_error_px")
            found = {name: context.figures.get(name) for name in names}
        seconds["all"] = time.process_time() - start
        wall = time.perf_counter() - wall
    return {"seconds": seconds, "wall": wall, "empty_mb": empty, "peak_mb": peak_memory(), "found": found}


def peak_memory() -> float:
    """Return the most memory that this process has held, MB; unlike getrusage, none of its parent's."""
    status = Path("/proc/self/status").read_text()
    return float(status.partition("VmHWM:")[2].split()[0]) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", default="32,200,1000")
    parser.add_argument("--metadata-only", action="store_true")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(run_one(options.one, options.metadata_only)))
        return
    print_machine("slideframe", "pycolmap", "pillow")
    results = {}
    for count in map(int, options.counts.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            write_survey(Path(folder), count)
            command = [sys.executable, __file__, "--one", folder] + ["--metadata-only"] * options.metadata_only
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            results[count] = json.loads(done.stdout.splitlines()[-1])
    print_table(results)


def print_table(results: dict[int, dict[str, Any]]) -> None:
    print(f"{'CPU-ms per photograph':<28}" + "".join(f"{count:>10}" for count in results))
    for name in [*(name for _, _, name in STEPS), "all"]:
        cells = [result["seconds"].get(name) for result in results.values()]
        if any(cell is not None for cell in cells):
            times = zip(cells, results, strict=True)
            print(f"{name:<28}" + "".join(f"{1e3 * (cell or 0.0) / count:>10.2f}" for cell, count in times))
    for key, name in (("peak_mb", "peak memory, MB"), ("empty_mb", "of it without a survey, MB")):
        print(f"{name:<28}" + "".join(f"{result[key]:>10.0f}" for result in results.values()))
    for count, result in results.items():
        print(f"{count} photographs: {result['wall']:.2f} s; {result['found']}")


if __name__ == "__main__":
    main()
