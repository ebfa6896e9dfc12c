"""Checkpoints: the newest that fits the stored frames is found, damaged ones are passed over."""

import numpy as np
import pytest

from slideframe.checkpoint import Checkpoints
from slideframe.device import Device
from slideframe.errors import StoreError
from slideframe.stages import Context


def checkpoints(folder, stored, every=5):
    return Checkpoints(Context(Device(), folder, stored=stored), every)


def state(frame):
    return {"positions": np.full((3, 3), frame, np.float32), "drift": np.array(0.5)}


@pytest.fixture
def written(tmp_path):
    for frame in (5, 10, 15):
        checkpoints(tmp_path, stored=0).write(frame, state(frame))
    return tmp_path


def test_the_newest_comes_back_bit_for_bit_and_the_stream_goes_on_after_it(written):
    kept = checkpoints(written, stored=18)
    frame, arrays = kept.latest()
    assert frame == 15
    assert kept.context.first_item == 16
    for name, values in state(15).items():
        np.testing.assert_array_equal(arrays[name], values)
        assert arrays[name].dtype == values.dtype


def test_a_checkpoint_beyond_the_stored_frames_is_of_no_use(written):
    assert checkpoints(written, stored=15).latest()[0] == 10
    few = checkpoints(written, stored=10)
    assert few.latest() is None
    assert few.context.first_item == 0


def test_only_two_are_kept(written):
    assert sorted(path.name for path in written.iterdir()) == ["after-frame-000010.npz", "after-frame-000015.npz"]


def test_a_damaged_one_is_passed_over(written):
    newest = written / "after-frame-000015.npz"
    newest.write_bytes(newest.read_bytes()[:100])
    assert checkpoints(written, stored=20).latest()[0] == 10


def test_they_are_due_every_so_many_frames_or_never(tmp_path):
    assert [frame for frame in range(1, 11) if checkpoints(tmp_path, 0, every=4).is_due(frame)] == [4, 8]
    assert not any(checkpoints(tmp_path, 0, every=0).is_due(frame) for frame in range(1, 11))


def test_a_disk_that_refuses_is_told_with_a_cure(tmp_path):
    (tmp_path / "after-frame-000005.partial").mkdir()
    with pytest.raises(StoreError, match="a folder stands in the way"):
        checkpoints(tmp_path, stored=0).write(5, state(5))
