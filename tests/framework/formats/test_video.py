"""Films: what is in them comes out again, the same twice, or nothing is left."""

import subprocess
import sys

import numpy as np
import pytest

from slideframe.errors import MissingDependency
from slideframe.formats import video

av = pytest.importorskip("av")

# Lossy coding of smooth pictures, mean over a picture in levels of 255.
CODING = 3.0

FULL_DISK = """
import resource, signal
from pathlib import Path
import numpy as np
from slideframe.errors import StoreError
from slideframe.formats.video import write_mp4

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
random = np.random.default_rng(0)
try:
    write_mp4((random.integers(0, 256, (240, 320, 3)).astype(np.uint8) for _ in range(60)), Path({path!r}), 25.0)
except StoreError as error:
    print(error)
"""


def pictures(count: int = 8) -> list[np.ndarray]:
    """A bright band that goes down over a ramp."""
    ramp = np.broadcast_to(np.linspace(40, 160, 96), (64, 96))
    found = []
    for index in range(count):
        grey = ramp.copy()
        grey[8 * index : 8 * index + 8] += 60
        found.append(np.dstack([grey, 0.8 * grey, 0.6 * grey]).astype(np.uint8))
    return found


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_a_film_shows_the_pictures_in_order_and_in_time(tmp_path, codec):
    video.write_mp4(iter(pictures()), tmp_path / "film.mp4", 20.0, codec)
    frames = list(video.read_frames(tmp_path / "film.mp4"))
    assert len(frames) == 8
    for frame, picture in zip(frames, pictures(), strict=True):
        assert np.abs(frame.astype(float) - picture).mean() < CODING
    with av.open(str(tmp_path / "film.mp4")) as container:
        assert float(container.streams.video[0].average_rate) == pytest.approx(20)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_the_same_pictures_give_the_same_bytes(tmp_path, codec):
    for name in ("a.mp4", "b.mp4"):
        video.write_mp4(iter(pictures()), tmp_path / name, 20.0, codec)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_full_disk_in_the_middle_is_an_error_that_leaves_nothing(tmp_path):
    program = FULL_DISK.format(path=str(tmp_path / "film.mp4"))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert "results can't be written" in done.stdout, done.stderr
    assert not list(tmp_path.iterdir())


def test_an_encoder_that_is_missing_is_said_before_anything_is_computed(monkeypatch, tmp_path):
    video.require_encoder("h264", "av1")
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    with pytest.raises(MissingDependency, match=r"libsvtav1(.|\n)*wheel"):
        video.require_encoder("av1")
    monkeypatch.setattr(video, "find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match=r"PyAV(.|\n)*--no-film"):
        video.write_mp4(iter(pictures()), tmp_path / "film.mp4", 20.0)
