import errno
import json

import numpy as np
import pytest

from slideframe.device import Device
from slideframe.errors import StoreError
from slideframe.products import ParticleFrame, Picture, SplatCloud
from slideframe.stages import Context
from slideframe.store import Store, Stream, digest, read_product, write_product


def frame(index: int) -> ParticleFrame:
    generator = np.random.default_rng(index)
    return ParticleFrame(
        time=index / 25,
        positions=generator.normal(size=(5, 3)).astype(np.float32),
        velocities=np.zeros((5, 3), np.float32),
        deformation_gradients=np.zeros((5, 3, 3), np.float32),
        escaped=index,
    )


def test_a_product_comes_back_bit_for_bit(tmp_path):
    write_product(tmp_path / "frame", frame(3))
    assert read_product(tmp_path / "frame", ParticleFrame) == frame(3)


def test_a_picture_is_kept_without_loss_as_an_image_file(tmp_path):
    picture = Picture(time=0.5, pixels=np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8))
    write_product(tmp_path / "picture", picture)
    assert (tmp_path / "picture" / "pixels.png").is_file()
    assert read_product(tmp_path / "picture", Picture) == picture


def test_an_empty_product_comes_back(tmp_path):
    empty = SplatCloud(
        centers=np.zeros((0, 3), np.float32),
        rotations=np.zeros((0, 4), np.float32),
        scales=np.zeros((0, 3), np.float32),
        opacities=np.zeros(0, np.float32),
        harmonics=np.zeros((0, 1, 3), np.float32),
    )
    write_product(tmp_path / "empty", empty)
    assert read_product(tmp_path / "empty", SplatCloud) == empty


def test_a_stream_is_a_sequence_read_item_by_item(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    entry.write_stream((frame(i) for i in range(4)), dict)
    stream = entry.read(ParticleFrame)
    assert isinstance(stream, Stream)
    assert len(stream) == 4
    assert stream[-1] == frame(3)
    assert [item.escaped for item in stream[1:3]] == [1, 2]
    with pytest.raises(IndexError):
        stream[4]


def test_a_result_is_whole_or_absent(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")

    def interrupted():
        yield frame(0)
        yield frame(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        entry.write_stream(interrupted(), dict)
    assert not entry.is_whole
    assert not entry.folder.exists()
    entry.write_stream((frame(i) for i in range(3)), dict)
    assert entry.is_whole
    assert len(entry.read(ParticleFrame)) == 3


def test_scratch_lives_until_its_result_is_whole(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    (entry.scratch / "checkpoint").write_text("kept")
    assert (entry.scratch / "checkpoint").read_text() == "kept"
    entry.write(frame(0), dict)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["solver-k"]


def test_a_full_disk_is_told_and_leaves_earlier_results(tmp_path, monkeypatch):
    store = Store(tmp_path)
    store.entry("solver", "before").write(frame(0), dict)

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "array.npy")

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(StoreError, match=r"No space left on device(.|\n)*array.npy(.|\n)*free some space"):
        store.entry("solver", "after").write(frame(1), dict)
    assert store.entry("solver", "before").is_whole
    assert not store.entry("solver", "after").is_whole


def test_a_folder_that_cannot_be_written_is_told_before_work_starts(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StoreError, match="can't be written"):
        Store(tmp_path / "file" / "store").open()


def test_a_damaged_result_is_told_with_its_folder(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    entry.write(frame(0), dict)
    (entry.folder / "product" / "positions.npy").write_bytes(b"\x93NUMPY rubbish")
    with pytest.raises(StoreError, match=r"damaged(.|\n)*solver-k(.|\n)*delete"):
        entry.read(ParticleFrame)


def test_the_manifest_says_what_the_result_was_made_from(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    entry.write(frame(0), lambda: {"figures": {"x_m": 1.5}})
    assert entry.manifest == {"figures": {"x_m": 1.5}, "length": None, "content": entry.content}
    assert json.loads((entry.folder / "manifest.json").read_text()) == entry.manifest


def test_content_tells_results_apart_and_nothing_else(tmp_path):
    same, again, other = (Store(tmp_path).entry("solver", key) for key in "abc")
    same.write_stream((frame(i) for i in range(3)), dict)
    again.write_stream((frame(i) for i in range(3)), lambda: {"figures": {"wall_seconds": 9}})
    other.write_stream((frame(i) for i in (0, 2, 1)), dict)
    assert same.content == again.content != other.content


def test_keys_depend_on_every_ingredient_but_not_on_order():
    assert digest({"a": 1, "b": [2]}) == digest({"b": [2], "a": 1})
    assert digest({"a": 1}) != digest({"a": 1.5})


def broken_stream(entry, whole):
    """Store some frames of a stream, then fail."""

    def frames():
        yield from (frame(index) for index in range(whole))
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        entry.write_stream(frames(), dict)


def test_a_broken_stream_goes_on_after_the_items_that_are_whole(tmp_path):
    entry, other = (Store(tmp_path).entry("solver", key) for key in ("broken", "unbroken"))
    assert entry.stored_items(ParticleFrame) == 0
    broken_stream(entry, 3)
    partial = tmp_path / "solver-broken.partial"
    (partial / "000003.partial").mkdir()  # as a kill in the middle of a write leaves it
    assert entry.stored_items(ParticleFrame) == 3
    assert not entry.is_whole
    entry.write_stream((frame(index) for index in (2, 3)), dict, lambda: 2)
    other.write_stream((frame(index) for index in range(4)), dict)
    assert list(entry.read(ParticleFrame)) == list(other.read(ParticleFrame))
    assert entry.content == other.content
    assert {path.name for path in entry.folder.iterdir()} == {path.name for path in other.folder.iterdir()}


def test_a_broken_stream_that_starts_anew_keeps_nothing(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    broken_stream(entry, 3)
    entry.write_stream(iter([frame(7)]), dict)
    assert list(entry.read(ParticleFrame)) == [frame(7)]
    assert not (entry.folder / "000001").exists()


def test_a_stream_of_which_all_items_were_stored_only_needs_its_manifest(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    broken_stream(entry, 2)
    entry.write_stream(iter(()), dict, lambda: 2)
    assert list(entry.read(ParticleFrame)) == [frame(0), frame(1)]


def test_a_damaged_item_of_a_broken_stream_ends_what_is_kept(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    broken_stream(entry, 3)
    (tmp_path / "solver-k.partial" / "000001" / "positions.npy").write_bytes(b"")
    assert entry.stored_items(ParticleFrame) == 1


def test_a_stage_can_resume_only_where_items_are_stored(tmp_path):
    context = Context(Device(), tmp_path, stored=3)
    assert context.first_item == 0
    context.resume(2)
    assert context.first_item == 2
    with pytest.raises(ValueError, match="3 are stored"):
        context.resume(4)


def test_pictures_that_a_stage_showed_stay_beside_its_result_and_decide_nothing(tmp_path):
    contents = []
    for kind in ("shown", "silent"):
        entry = Store(tmp_path).entry(kind, "k")
        context = Context(device=Device(), scratch=entry.scratch, pictures=entry.pictures_of_stage)
        if kind == "shown":
            context.show("a.jpg", 25, np.full((8, 8, 3), 200, np.uint8))
        entry.write(SplatCloud.empty(), lambda: {"figures": {}})
        contents.append(entry.content)
    assert contents[0] == contents[1]
    assert [path.name for path in Store(tmp_path).entry("shown", "k").pictures.glob("*/*")] == ["00000025.jpg"]
    assert not Store(tmp_path).entry("silent", "k").pictures.exists()
