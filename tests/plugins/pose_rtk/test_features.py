"""Features and matches are found once, and taken from the shelf after that."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.stages import Context
from slideframe_pose_rtk import features as module
from slideframe_pose_rtk.features import FeatureOptions, find_features

OPTIONS = FeatureOptions(feature_limit=500, size_limit=400)


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    generator = np.random.default_rng(2)
    paths = [tmp_path / f"{index}.png" for index in range(3)]
    for path in paths:
        blocks = generator.integers(0, 255, (20, 30), dtype=np.uint8)
        Image.fromarray(np.kron(blocks, np.ones((10, 10), np.uint8))).save(path)
    return paths


def test_a_photograph_is_looked_at_once(
    pictures: list[Path], tmp_path: Path, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = []
    extract = module._extract
    monkeypatch.setattr(module, "_extract", lambda *given: looked_at.append(given[1].name) or extract(*given))
    shelf = tmp_path / "shelf"
    first = find_features(pictures[:2], ["a", "b"], OPTIONS, shelf, context)
    assert looked_at == ["0.png", "1.png"]
    again = find_features(pictures, ["a", "b", "c"], OPTIONS, shelf, context)
    assert looked_at == ["0.png", "1.png", "2.png"]
    for one, other in zip(first, again, strict=False):
        assert np.array_equal(one.keypoints, other.keypoints)
        assert np.array_equal(one.descriptors, other.descriptors)
        assert one.quality == other.quality
    assert len(first[0].keypoints) > 50
    find_features(pictures[:1], ["a"], FeatureOptions(501, 400), shelf, context)
    assert looked_at[3:] == ["0.png"], "other options, other features"


def test_a_damaged_file_on_the_shelf_counts_as_absent(pictures: list[Path], tmp_path: Path, context: Context) -> None:
    shelf = tmp_path / "shelf"
    known = find_features(pictures[:1], ["a"], OPTIONS, shelf, context)[0]
    (shelf / f"{known.key}.npz").write_bytes(b"PK\x03\x04 cut off")
    found = find_features(pictures[:1], ["a"], OPTIONS, shelf, context)[0]
    assert np.array_equal(found.keypoints, known.keypoints)


def test_what_cannot_be_decoded_has_no_features_and_is_named(tmp_path: Path, context: Context) -> None:
    path = tmp_path / "cut.jpg"
    path.write_bytes(b"\xff\xd8\xff\xe0 cut off")
    (found,) = find_features([path], ["a"], OPTIONS, tmp_path / "shelf", context)
    assert found.quality is None
    assert len(found.keypoints) == 0
    assert "cut.jpg" in context.warnings[0]
