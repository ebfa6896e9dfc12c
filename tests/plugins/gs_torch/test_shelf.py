"""Photographs beyond the memory that training may take for them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from slideframe.errors import StageFailed
from slideframe.products import Camera
from slideframe_gs_torch.shelf import FACTORS, Shelf, ShelvedViews
from slideframe_gs_torch.views import TrainingView

CAMERA = Camera(width=320, height=240, focal_x=300.0, focal_y=300.0, principal_x=160.0, principal_y=120.0)
POSE = np.column_stack([np.eye(3), [0.0, 0.0, -5.0]])
# one view in full and reduced by two and by four, with its mask
BYTES = 4 * (320 * 240 + 160 * 120 + 80 * 60)


def view(index: int) -> TrainingView:
    random = torch.Generator().manual_seed(index)
    pixels = torch.randint(0, 256, (3, 240, 320), generator=random, dtype=torch.uint8)
    mask = torch.rand(240, 320, generator=random) > 0.01
    return TrainingView(f"{index}.jpg", pixels, mask, CAMERA, POSE, index)


@pytest.mark.parametrize(("room", "in_memory", "files"), [(3 * BYTES, 3 * BYTES, 0), (BYTES, BYTES, 6), (0, 0, 9)])
def test_views_come_back_the_same_from_memory_and_from_disk(tmp_path, room, in_memory, files):
    shelf = Shelf(tmp_path / "photographs", room)
    shelved = ShelvedViews((view(index) for index in range(3)), shelf)
    assert shelf.held == in_memory
    assert len(list(tmp_path.rglob("*.npy"))) == files
    assert len(shelved) == 3
    for index, found in enumerate(shelved):
        for factor in FACTORS:
            expected, got = view(index).reduced(factor), shelved.reduced(index, factor)
            assert torch.equal(got.pixels, expected.pixels)
            assert torch.equal(got.mask, expected.mask)
            assert (got.name, got.camera, got.index) == (expected.name, expected.camera, index)
        assert torch.equal(found.pixels, view(index).pixels)


def test_views_are_read_one_at_a_time(tmp_path):
    alive = []

    def views():
        for index in range(3):
            assert len(alive) == index
            alive.append(index)
            yield view(index)

    ShelvedViews(views(), Shelf(tmp_path, 0))
    assert alive == [0, 1, 2]


def test_depths_stay_with_every_width(tmp_path):
    shelved = ShelvedViews([view(0)], Shelf(tmp_path, 0))
    assert shelved[0].depths is None
    shelved.add_depths(np.float32([[0, 0, 0], [1, 0, 0]]))
    for factor in FACTORS:
        found = shelved.reduced(0, factor)
        assert found.depths.depths.tolist() == pytest.approx([5, 5])
        assert found.depths.columns.max() < 320 // factor


def test_a_disk_without_room_is_named_with_the_ways_out(tmp_path):
    (tmp_path / "photographs").write_text("in the way")
    with pytest.raises(StageFailed, match="photographs_megabytes") as caught:
        ShelvedViews([view(0)], Shelf(tmp_path / "photographs", 0))
    assert "image_width" in str(caught.value)


SHELVING = """
import sys
from pathlib import Path
import numpy as np
from PIL import Image
from slideframe.device import Device
from slideframe.products import Camera, Georeference, Photograph, Survey
from slideframe.stages import Context
from slideframe_gs_torch.shelf import Shelf, ShelvedViews
from slideframe_gs_torch.views import load_views

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

folder, count = Path(sys.argv[1]), 40
Image.fromarray(np.random.default_rng(0).integers(0, 256, (900, 1200, 3), np.uint8)).save(folder / "one.jpg")
camera = Camera(
    width=1200, height=900, focal_x=850, focal_y=850, principal_x=600, principal_y=450, distortion=(-0.1, 0, 0, 0, 0)
)
survey = Survey(
    georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
    cameras=(camera,),
    photographs=tuple(Photograph(path=folder / "one.jpg", camera=0, sha256="") for _ in range(count)),
    world_from_camera=np.tile(np.eye(3, 4), (count, 1, 1)),
    position_sigma=np.ones((count, 3)),
    sparse_points=np.zeros((0, 3), np.float32),
    sparse_colors=np.zeros((0, 3), np.uint8),
    sparse_errors=np.zeros(0, np.float32),
)
context = Context(device=Device(), scratch=folder)
few = ShelvedViews(load_views(survey, range(4), 640, context), Shelf(folder / "few", 0))
before = resident()
many = ShelvedViews(load_views(survey, range(count), 640, context), Shelf(folder / "many", 0))
print(resident() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="memory is looked up in Linux's /proc")
def test_photographs_on_disk_take_no_memory(tmp_path):
    found = subprocess.run(
        [sys.executable, "-c", SHELVING, str(tmp_path)], capture_output=True, text=True, check=True
    ).stdout
    # 40 photographs, each 0.9 MB undistorted at 640 px, and some ten times that while it is read
    assert float(found) < 25
