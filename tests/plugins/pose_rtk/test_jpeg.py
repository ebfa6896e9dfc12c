from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe_pose_rtk.jpeg import app1_segments, lacks_its_end


@pytest.fixture
def noisy(tmp_path: Path) -> Path:
    path = tmp_path / "noisy.jpg"
    pixels = np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8)
    # a thumbnail in EXIF ends in the same mark as the picture
    exif = Image.Exif()
    Image.fromarray(pixels).save(path, "JPEG", exif=exif, quality=95)
    return path


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.9999])
def test_a_file_that_breaks_off(noisy: Path, share: float) -> None:
    assert not lacks_its_end(noisy)
    data = noisy.read_bytes()
    noisy.write_bytes(data[: int(len(data) * share)])
    assert lacks_its_end(noisy)


def test_what_follows_the_picture_is_no_break(noisy: Path) -> None:
    noisy.write_bytes(noisy.read_bytes() + b"\x00" * 20_000)
    assert not lacks_its_end(noisy)


def test_segments_in_order(tmp_path: Path, photograph: Callable[..., Path]) -> None:
    path = photograph(tmp_path / "a.jpg", {"RtkFlag": "50"})
    with path.open("rb") as file:
        exif, xmp = app1_segments(file)
    assert exif.startswith(b"Exif\x00")
    assert xmp.startswith(b"http://ns.adobe.com/xap/1.0/\x00")


def test_other_files_have_none(tmp_path: Path) -> None:
    path = tmp_path / "letter.JPG"
    path.write_text("Dear drone,")
    with path.open("rb") as file:
        assert list(app1_segments(file)) == []
