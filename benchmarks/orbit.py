"""An oblique orbit of the demo's slope, all at one pitch, told with less and less metadata, against the truth.

    python benchmarks/orbit.py [--count 20] [--width 640] [--keep FOLDER]

The hardest geometry for a lens: nothing but positions and small differences of pitch tell the focal length. Each row
takes something away: the calibration, a right focal length, RTK, and at last all XMP, so that MakerNote and EXIF's
position and lens are left, without a height above take-off.
"""

import argparse
import io
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from cameras import HEAD, Truth, locate, print_accuracy
from machine import print_machine
from PIL import ExifTags, Image

from slideframe.demo.flight import FLIGHT_MEAN, Flight
from slideframe.demo.lens import pixel_rays, reduced_camera
from slideframe.demo.metadata import Shot, exif_of, xmp_of
from slideframe.demo.scene import build_scene
from slideframe.demo.survey import ORIGIN
from slideframe.geodesy import geodetic_from_enu

RADIUS, HEIGHT, PITCH = 75.0, 70.0, -38.0  # m, m above the road, degrees
SLOPE = np.array([2.0, 10.0])  # its middle, m east and north of the origin
RTK_SIGMA = (0.012, 0.012, 0.02)  # m
GPS_SIGMA = (1.5, 1.5, 1.5)  # m
COMPASS_BIAS, GIMBAL_NOISE = 0.8, 0.3  # degrees
CALIBRATION = rb"DewarpData|CalibratedFocalLength|CalibratedOpticalCenter[XY]"
RTK = rb"RtkFlag|RtkStdLon|RtkStdLat|RtkStdHgt|RtkDiffAge|GpsStatus|AltitudeType"

Headers = tuple[Image.Exif, bytes | None]


def fly(count: int) -> Flight:
    """Fly once round, by hand: 0.2 m and half a degree of pitch beside the plan."""
    random = np.random.default_rng(3)
    heading = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around = SLOPE + RADIUS * np.column_stack([np.sin(heading), np.cos(heading)])
    positions = np.column_stack([around, np.full(count, HEIGHT - FLIGHT_MEAN[2])])
    positions += random.normal(0, 0.2, positions.shape)
    yaw = np.degrees(heading) % 360 - 180
    angles = np.column_stack([yaw, np.full(count, PITCH), np.zeros(count)])
    angles += random.normal(0, (0.9, 0.4, 0.05), angles.shape)
    sigma = np.tile(RTK_SIGMA, (count, 1))
    reported = np.round(angles + random.normal((COMPASS_BIAS, 0, 0), GIMBAL_NOISE, angles.shape), 1)
    reported[:, 0] = (reported[:, 0] + 180) % 360 - 180
    return Flight(positions, angles, positions + random.normal(0, sigma), reported, sigma)


def shots_of(flight: Flight, positions: np.ndarray) -> list[Shot]:
    geodetic = geodetic_from_enu(positions, ORIGIN)
    return [
        Shot(
            number=index + 1,
            geodetic=geodetic[index],
            above_take_off=HEIGHT,
            gimbal=flight.reported_angles[index],
            position_sigma=flight.position_sigma[index],
        )
        for index in range(len(positions))
    ]


def without(tags: bytes, packet: bytes) -> bytes:
    return re.sub(rb"\s+drone-dji:(" + tags + rb')="[^"]*"', b"", packet)


def exif_with(shot: Shot, equivalent: int, note: bytes = b"") -> Image.Exif:
    exif = exif_of(shot)
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = equivalent
    if note:
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.MakerNote] = note
    return exif


def note_of(shot: Shot) -> bytes:
    """Write the gimbal's angles as the Mavic 2's generation does, in tenths."""
    yaw, pitch, roll = (round(10 * angle) for angle in shot.gimbal)
    return f"[ae_dbg_info:][GimbalDegree(Y,P,R):{yaw},{pitch},{roll}]".encode()


def tellings(flight: Flight) -> Iterator[tuple[str, list[Shot], Callable[[Shot], Headers]]]:
    """Yield what the metadata may leave out; the true equivalent focal length is 24.4 mm."""
    random = np.random.default_rng(5)
    exact = shots_of(flight, flight.reported_positions)
    rough = shots_of(flight, flight.positions + random.normal(0, GPS_SIGMA, flight.positions.shape))
    yield "as written", exact, lambda shot: (exif_of(shot), xmp_of(shot))
    yield "EXIF's lens", exact, lambda shot: (exif_with(shot, 24), without(CALIBRATION, xmp_of(shot)))
    yield "a lens 7 % off", exact, lambda shot: (exif_with(shot, 26), without(CALIBRATION, xmp_of(shot)))
    bare = CALIBRATION + b"|" + RTK
    yield "the same, no RTK, 1.5 m", rough, lambda shot: (exif_with(shot, 26), without(bare, xmp_of(shot)))
    yield "MakerNote and EXIF, 1.5 m", rough, lambda shot: (exif_with(shot, 26, note_of(shot)), None)


def write(folder: Path, pictures: list[np.ndarray], shots: list[Shot], headers: Callable[[Shot], Headers]) -> Path:
    folder.mkdir(parents=True)
    for picture, shot in zip(pictures, shots, strict=True):
        exif, packet = headers(shot)
        stream = io.BytesIO()
        extra = {"xmp": packet} if packet else {}
        Image.fromarray(picture).save(stream, "JPEG", quality=92, exif=exif, **extra)
        (folder / shot.file_name).write_bytes(stream.getvalue())
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--keep", type=Path, help="folder for the photographs, to use them elsewhere")
    options = parser.parse_args()
    print_machine("slideframe-pose-rtk", "pycolmap", "numpy", "pillow")
    print(
        f"{options.count} photographs of {options.width} px, {-PITCH:.0f} degrees down, {RADIUS:.0f} m around\n{HEAD}"
    )
    flight, camera = fly(options.count), reduced_camera(options.width)
    scene, rays = build_scene(camera.width), pixel_rays(camera)
    poses = flight.world_from_camera
    pictures = [scene.photograph(camera, rays, pose, seed=number) for number, pose in enumerate(poses)]
    with tempfile.TemporaryDirectory() as temporary:
        for number, (title, shots, headers) in enumerate(tellings(flight)):
            folder = write((options.keep or Path(temporary)) / str(number), pictures, shots, headers)
            truth = Truth(folder, ORIGIN, {shot.file_name: pose for shot, pose in zip(shots, poses, strict=True)})
            cache = Path(temporary) / "cache"
            cache.mkdir(exist_ok=True)
            _, survey, context = locate(folder, cache, origin=ORIGIN)
            print_accuracy(title, truth, survey, context)
            print(f"    focal length {survey.cameras[0].focal_x / camera.focal_x - 1:+.2%} off,", end=" ")
            print(context.figures["focal_length_rule"])


if __name__ == "__main__":
    main()
