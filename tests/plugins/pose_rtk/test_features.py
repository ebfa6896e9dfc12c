"""Features and matches are found once, and taken from the shelf after that."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.stages import Context
from slideframe_pose_rtk import features as module
from slideframe_pose_rtk.features import FeatureOptions, PictureFile, find_features

OPTIONS = FeatureOptions(feature_limit=500, size_limit=400)


def files(paths: list[Path]) -> list[PictureFile]:
    return [PictureFile(path, f"digest of {path.name}") for path in paths]


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
    monkeypatch.setattr(module, "_extract", lambda *given: looked_at.append(given[1].path.name) or extract(*given))
    shelf = tmp_path / "shelf"
    first = find_features(files(pictures[:2]), OPTIONS, shelf, context)
    assert looked_at == ["0.png", "1.png"]
    again = find_features(files(pictures), OPTIONS, shelf, context)
    assert looked_at == ["0.png", "1.png", "2.png"]
    for one, other in zip(first, again, strict=False):
        assert np.array_equal(one.keypoints, other.keypoints)
        assert np.array_equal(one.descriptors, other.descriptors)
        assert one.quality == other.quality
    assert len(first[0].keypoints) > 50
    find_features(files(pictures[:1]), FeatureOptions(501, 400), shelf, context)
    assert looked_at[3:] == ["0.png"], "other options, other features"


def test_a_damaged_file_on_the_shelf_counts_as_absent(pictures: list[Path], tmp_path: Path, context: Context) -> None:
    shelf = tmp_path / "shelf"
    known = find_features(files(pictures[:1]), OPTIONS, shelf, context)[0]
    (shelf / f"{known.key}.npz").write_bytes(b"PK\x03\x04 cut off")
    found = find_features(files(pictures[:1]), OPTIONS, shelf, context)[0]
    assert np.array_equal(found.keypoints, known.keypoints)


def test_what_cannot_be_decoded_has_no_features_and_is_named(tmp_path: Path, context: Context) -> None:
    path = tmp_path / "cut.jpg"
    path.write_bytes(b"\xff\xd8\xff\xe0 cut off")
    (found,) = find_features(files([path]), OPTIONS, tmp_path / "shelf", context)
    assert found.quality is None
    assert len(found.keypoints) == 0
    assert "cut.jpg" in context.warnings[0]


def test_a_mask_takes_features_away_and_keeps_the_rest(pictures: list[Path], tmp_path: Path, context: Context) -> None:
    black_left = np.full((200, 300), 255, np.uint8)
    black_left[:, :150] = 0
    Image.fromarray(black_left).save(tmp_path / "mask.png")
    masked = PictureFile(pictures[0], "digest of 0.png", tmp_path / "mask.png", "digest of the mask")
    (found,) = find_features([masked], OPTIONS, tmp_path / "shelf", context)
    (whole,) = find_features(files(pictures[:1]), OPTIONS, tmp_path / "shelf", context)
    assert found.key != whole.key
    right = whole.keypoints[:, 0] >= 150
    assert 0 < right.sum() < len(right)
    np.testing.assert_array_equal(found.keypoints, whole.keypoints[right])
    np.testing.assert_array_equal(found.descriptors, whole.descriptors[right])
