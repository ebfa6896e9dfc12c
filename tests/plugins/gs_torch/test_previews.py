"""Pictures of how training comes along."""

import dataclasses

import numpy as np
import pytest
import torch
from PIL import Image

from slideframe.device import Device
from slideframe.products import Camera
from slideframe.stages import Context
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters
from slideframe_gs_torch.previews import Previews
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_gs_torch.views import TrainingView

CAMERA = Camera(width=40, height=30, focal_x=40.0, focal_y=40.0, principal_x=20.0, principal_y=15.0)
BEHIND = (0.2, 0.4, 0.6)


def state_at(iteration: int) -> State:
    """A single invisible splat."""
    raw = {
        "centers": torch.zeros(1, 3),
        "rotations": torch.tensor([[1.0, 0, 0, 0]]),
        "log_scales": torch.full((1, 3), -3.0),
        "logits": torch.full((1,), -12.0),
        "harmonics": torch.zeros(1, 4, 3),
    }
    return State(Parameters(raw), Adam(), torch.zeros(1), 1, Exposures.of(1), iteration=iteration)


def previews(first: int = 0, **options) -> Previews:
    pixels = torch.full((3, 30, 40), 128, dtype=torch.uint8)
    pose = np.column_stack([np.eye(3), [0.0, 0.0, -5.0]])
    views = [TrainingView(f"{index}.jpg", pixels, None, CAMERA, pose) for index in range(3)]
    return Previews.of(TorchSplats(iterations=100, **options), views, BEHIND, first)


@pytest.fixture
def context(tmp_path) -> Context:
    return Context(device=Device(), scratch=tmp_path, pictures=tmp_path / "pictures")


def shown(context: Context) -> list[int]:
    return sorted(int(path.stem) for path in context.pictures.glob("1.jpg/*.jpg"))


def train_until(last: int, pictures: Previews, context: Context) -> None:
    for iteration in range(1, last + 1):
        pictures.show_if_due(state_at(iteration), context)
    pictures.show_last(state_at(last), context)


def test_so_many_are_shown_of_the_middle_view_evenly_the_last_at_the_end(context):
    train_until(100, previews(previews=4), context)
    assert shown(context) == [25, 50, 75, 100]
    assert [path.name for path in context.pictures.iterdir()] == ["1.jpg"]


def test_a_training_that_settles_early_shows_what_it_came_to_and_a_second_block_goes_on_counting(context):
    train_until(60, previews(first=200, previews=4), context)
    assert shown(context) == [225, 250, 260]


def test_none_are_shown_where_none_are_asked_for_or_nobody_looks(context):
    train_until(100, previews(previews=0), context)
    train_until(100, previews(previews=4), dataclasses.replace(context, pictures=None))
    assert not context.pictures.exists()


def test_the_photograph_stands_left_and_its_splats_right(context):
    train_until(100, previews(previews=1), context)
    picture = np.asarray(Image.open(context.pictures / "1.jpg" / "00000100.jpg")).astype(float)
    assert picture.shape == (30, 80, 3)
    np.testing.assert_allclose(picture[:, 4:36].mean(axis=(0, 1)), 128, atol=3)
    np.testing.assert_allclose(picture[:, 44:76].mean(axis=(0, 1)), 255 * np.array(BEHIND), atol=3)


def test_a_disk_without_room_costs_the_pictures_alone(context, caplog):
    context.pictures.write_text("in the way")
    train_until(100, previews(previews=1), context)
    assert "could not be kept" in caplog.text
