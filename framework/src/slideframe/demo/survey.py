"""Writes the demo survey: photographs as a drone writes them, and the truth behind them."""

import io
import json
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.arrays import UInt8Array
from slideframe.demo.flight import FLIGHT_MEAN, PHOTOGRAPH_COUNT, Flight, fly
from slideframe.demo.height_model import write_height_model
from slideframe.demo.lens import pixel_rays, reduced_camera
from slideframe.demo.metadata import Shot, exif_of, xmp_of
from slideframe.demo.scene import Scene, build_scene, worker_count
from slideframe.errors import ConfigurationError
from slideframe.geodesy import geodetic_from_enu
from slideframe.products import Camera, Georeference

GENERATOR_VERSION = 2  # raise it with any change of a single bit, so that old surveys are made again
# Hills of Hong Kong Island; the mean of the true camera positions
ORIGIN = Georeference(latitude=22.2809, longitude=114.2196, ellipsoidal_height=148.4)
MANIFEST = "slideframe_demo_survey.json"
JPEG_QUALITY = 92

Progress = Callable[[float, float], None]


def write_demo_survey(
    folder: Path, *, width: int = 1200, photograph_count: int | None = None, progress: Progress | None = None
) -> Path:
    """Photograph the demo's slope and return the folder of the photographs, `folder / "photographs"`.

    `folder / "ground_truth"` receives cameras.json (origin, camera, world_from_camera of every photograph),
    terrain.npz (see `Scene.ground_truth`) and its heights as a height model in longitude and latitude, terrain.asc.
    The same options give the same bytes. A finished survey with these options is left as it is, one with other
    options is replaced, and an unfinished one never shows.

    Args:
        folder: made if it doesn't exist.
        width: of the pictures, px; the height follows from the camera.
        photograph_count: 3 to 32, evenly chosen from the flight; all where not given.
        progress: told how many of how many photographs are done.

    Raises:
        ConfigurationError: `folder` holds something else, or an option is out of range.
    """
    if not 64 <= width <= 5280:
        raise ConfigurationError(f"the demo survey can't be {width} px wide", where="width", cure="choose 64 to 5280")
    manifest = {
        "generator_version": GENERATOR_VERSION,
        "width": width,
        "photograph_count": PHOTOGRAPH_COUNT if photograph_count is None else photograph_count,
    }
    folder = Path(folder)
    if not _is_finished(folder, manifest):
        flight = fly(photograph_count)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as scratch:
            whole = Path(scratch) / "survey"
            _write(whole, reduced_camera(width), flight, progress or (lambda done, total: None))
            (whole / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
            if folder.exists():
                folder.rename(Path(scratch) / "replaced")
            whole.rename(folder)
    return folder / "photographs"


def _is_finished(folder: Path, manifest: dict[str, int]) -> bool:
    """Tell whether the survey is there already, and refuse to touch a folder of anything else."""
    written = folder / MANIFEST
    if written.is_file():
        return bool(json.loads(written.read_text()) == manifest)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigurationError(
            f"{folder} is in use and holds no demo survey", where="folder", cure="name an empty or a new folder"
        )
    return False


def _write(folder: Path, camera: Camera, flight: Flight, progress: Progress) -> None:
    photographs, truth = folder / "photographs", folder / "ground_truth"
    photographs.mkdir(parents=True)
    truth.mkdir()
    shots = _shots(flight)
    progress(0, len(shots))
    scene = build_scene(camera.width)
    for done, (shot, data) in enumerate(zip(shots, _developed(scene, camera, flight, shots), strict=True), start=1):
        (photographs / shot.file_name).write_bytes(data)
        progress(done, len(shots))
    cameras = {
        "origin": ORIGIN.model_dump(),
        "camera": camera.model_dump(),
        "world_from_camera": {
            shot.file_name: pose.tolist() for shot, pose in zip(shots, flight.world_from_camera, strict=True)
        },
    }
    (truth / "cameras.json").write_text(json.dumps(cameras, indent=1) + "\n")
    terrain = scene.ground_truth()
    np.savez(truth / "terrain.npz", allow_pickle=False, **terrain)
    write_height_model(truth / "terrain.asc", terrain["x"], terrain["y"], terrain["heights"], ORIGIN)


def _shots(flight: Flight) -> list[Shot]:
    geodetic = geodetic_from_enu(flight.reported_positions, ORIGIN)
    return [
        Shot(
            number=index + 1,
            geodetic=geodetic[index],
            above_take_off=float(flight.reported_positions[index, 2] + FLIGHT_MEAN[2]),
            gimbal=flight.reported_angles[index],
            position_sigma=flight.position_sigma[index],
        )
        for index in range(len(geodetic))
    ]


def _developed(scene: Scene, camera: Camera, flight: Flight, shots: list[Shot]) -> Iterator[bytes]:
    """Yield the JPEG file of every shot in order, made by several threads (NumPy and Pillow let go of the lock)."""
    rays = pixel_rays(camera)

    def develop(index: int) -> bytes:
        picture = scene.photograph(camera, rays, flight.world_from_camera[index], seed=1000 + shots[index].number)
        return _jpeg(picture, shots[index])

    with ThreadPoolExecutor(worker_count()) as pool:
        yield from pool.map(develop, range(len(shots)))


def _jpeg(picture: UInt8Array, shot: Shot) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=JPEG_QUALITY, exif=exif_of(shot), xmp=xmp_of(shot))
    return stream.getvalue()
