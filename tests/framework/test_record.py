import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from slideframe.problem import Sand, Simulation, SimulationProblem
from slideframe.products import Picture
from slideframe.record import Recording, drawing, log_film, log_motion
from slideframe.record.blueprint import SOIL
from slideframe.record.motion import Drawn
from slideframe.record.soil import fields_of
from slideframe.record.training import log_training
from slideframe.testing.ground_scenes import hillside_filling, hillside_splats, moving_frames

FULL_DISK = """
import resource, signal
from pathlib import Path
import numpy as np, rerun as rr
from slideframe import record
from slideframe.errors import StoreError
from slideframe.record import stream

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
stream.STALL_SECONDS, stream.LOOK_SECONDS = 1.0, 0.2  # a writer that died unnoticed is waited for
recording = record.Recording(Path({path!r}), "full")

def limit(length):
    resource.setrlimit(resource.RLIMIT_FSIZE, (length, length))

def log(after=lambda: None):
    for index in range(20):
        recording.stream.set_time("sim_time", duration=index / 10)
        recording.stream.log("points", rr.Points3D(np.random.default_rng(index).normal(size=(20_000, 3))))
        after()

try:
    {steps}
    recording.close()
except StoreError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "steps",
    [
        "limit(200_000); log()",
        "limit(200_000); log(recording.flush)",
        "log(); limit(recording.flush() + 10)",  # room for all but the file's index
    ],
)
def test_a_full_disk_under_the_recording_is_an_error_that_leaves_nothing_and_ends(tmp_path, steps):
    program = FULL_DISK.format(path=str(tmp_path / "recording.rrd"), steps=steps)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert re.search(r"can't be written, [\d,]+ MB.*\n.*recording\.rrd\n.*free some space", done.stdout), done.stderr
    assert not list(tmp_path.iterdir())


def test_thinning_is_even_and_keeps_both_ends():
    assert drawing.thinned(5, 10).tolist() == [0, 1, 2, 3, 4]
    kept = drawing.thinned(1001, 11)
    assert kept.tolist() == list(range(0, 1001, 100))


def test_quaternions_and_colours_are_rerun_s():
    assert drawing.real_part_last(np.float32([[1, 2, 3, 4]])).tolist() == [[2, 3, 4, 1]]
    harmonics = np.zeros((2, 1, 3), np.float32)
    harmonics[1] = 0.5 / drawing.HARMONIC_0
    rgba = drawing.rgba(harmonics, np.float32([0.2, 1]))
    assert rgba.tolist() == [[128, 128, 128, 51], [255, 255, 255, 255]]


@pytest.mark.parametrize(("share", "colour"), [(0.0, [70, 90, 130]), (0.5, [240, 210, 80]), (1.0, [190, 30, 30])])
def test_heat_runs_from_blue_over_yellow_to_red(share, colour):
    assert drawing.heat(np.float32([share])).tolist() == [colour]


PROBLEM = SimulationProblem(
    material=Sand(friction_angle=30, density=1600, youngs_modulus=1e6, poisson_ratio=0.2),
    simulation=Simulation(duration=1, grid_spacing=1),
)


def entities_of(path) -> dict[str, int]:
    """Every entity of a recording and its number of rows."""
    import rerun.chunk

    rows: dict[str, int] = {}
    for chunk in rerun.chunk.RrdReader(str(path)).stream():
        rows[str(chunk.entity_path)] = rows.get(str(chunk.entity_path), 0) + chunk.num_rows
    return rows


def motion_recording(path, budget: int) -> list[str]:
    recording, filling = Recording(path, "test"), hillside_filling()
    frames = moving_frames(filling, frame_count=6, step=0.5)
    scene = hillside_splats(), filling, frames
    left_out = log_motion(recording.stream, *scene, PROBLEM, budget, lambda done, total: None)
    assert recording.flush() > 0
    recording.close()
    return left_out


def test_a_motion_within_its_budget_is_all_there(tmp_path):
    assert motion_recording(tmp_path / "a.rrd", 10**9) == []
    rows = entities_of(tmp_path / "a.rrd")
    assert rows["/motion/splats"] == 6 + 1  # and what lasts
    assert rows["/motion/particles"] == rows["/map/thickness"] == 6
    for name in ("energy/kinetic", "energy/potential", "mass/moving", "travel/front", "volume/outside"):
        assert rows[f"/figures/{name}"] == 6, name


def test_soil_that_carries_stress_is_drawn_by_it(tmp_path):
    recording, filling = Recording(tmp_path / "soil.rrd", "test", stressed=True), hillside_filling()
    count = len(filling.particle_positions)
    frames = [
        frame.model_copy(
            update={
                "mean_stresses": np.linspace(-1e4, 1e3, count, dtype=np.float32),
                "deviatoric_stresses": np.full(count, 2e3, np.float32),
                "plastic_strains": np.linspace(0, 0.1 * index, count, dtype=np.float32),
            }
        )
        for index, frame in enumerate(moving_frames(filling, frame_count=3, step=0.5))
    ]
    assert fields_of(frames[0])["pressure"].tolist()[:1] == [1e4]
    assert fields_of(frames[0])["pressure"].min() == 0
    scene = hillside_splats(), filling, frames
    log_motion(recording.stream, *scene, PROBLEM, 10**9, lambda done, total: None)
    recording.close()
    rows = entities_of(tmp_path / "soil.rrd")
    assert {rows[f"/soil/{name}"] for name in SOIL} == {3}


def test_beyond_its_budget_frames_are_left_out_and_it_is_said(tmp_path):
    splats = len(hillside_splats()) + 2 * len(hillside_filling().particle_positions)
    left_out = motion_recording(tmp_path / "b.rrd", 3 * 23 * splats)
    assert left_out == ["3 of 6 frames of the motion are drawn"]
    rows = entities_of(tmp_path / "b.rrd")
    assert rows["/motion/particles"] == 3
    assert rows["/figures/energy/kinetic"] == 6
    assert (tmp_path / "b.rrd").stat().st_size < 1.5e6


def test_the_film_is_a_video_with_a_frame_at_each_picture_s_time(tmp_path):
    pytest.importorskip("av")
    recording = Recording(tmp_path / "film.rrd", "test")
    film = [Picture(time=0.1 * i, pixels=np.full((48, 64, 3), 30 * i, np.uint8)) for i in range(5)]
    assert log_film(recording.stream, film, 10.0) == []
    recording.close()
    assert entities_of(tmp_path / "film.rrd")["/film"] == 5 + 1


def test_without_its_encoder_the_film_is_pictures_and_it_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(pytest.importorskip("av"), "codecs_available", set())
    recording = Recording(tmp_path / "film.rrd", "test")
    film = [Picture(time=0.1 * i, pixels=np.full((48, 64, 3), 30 * i, np.uint8)) for i in range(3)]
    (left_out,) = log_film(recording.stream, film, 10.0)
    assert "JPEG" in left_out
    assert "libsvtav1" in left_out
    recording.close()
    assert entities_of(tmp_path / "film.rrd")["/film"] == 3


def test_splats_are_thinned_before_frames():
    drawn = Drawn.within(900_000, 500_000, 100, 400_000_000)
    assert len(drawn.splats) == 300_000
    assert len(drawn.particles) == 100_000
    assert 40 < len(drawn.frames) < 60
    assert drawn.frames[0] == 0
    assert drawn.frames[-1] == 99


def test_pictures_of_the_training_lie_on_its_iterations(tmp_path):
    import rerun.chunk

    for iteration in (200, 25):
        path = tmp_path / "pictures" / "DJI 1.JPG" / f"{iteration:08d}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (8, 8)).save(path)
    recording = Recording(tmp_path / "training.rrd", "test", pictured=True)
    log_training(recording.stream, tmp_path / "pictures")
    recording.close()
    (chunk,) = (
        chunk
        for chunk in rerun.chunk.RrdReader(str(tmp_path / "training.rrd")).stream()
        if "training" in str(chunk.entity_path)
    )
    batch = chunk.to_record_batch()
    assert batch.column("iteration").to_pylist() == [25, 200]
    assert {time.total_seconds() for time in batch.column("sim_time").to_pylist()} == {0.0}
