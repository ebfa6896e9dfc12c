from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.errors import InputError
from slideframe.masks import find_masks, mask_files, read_mask


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "masks"
    (folder / "sub").mkdir(parents=True)
    for name in ("DJI_0001.png", "dji_0002_mask.JPG", "sub/DJI_0003.JPG.png"):
        Image.new("L", (8, 6), 255).save(folder / name)
    return folder


def test_masks_are_found_by_name(folder: Path) -> None:
    photographs = [Path(f"x/DJI_000{number}.JPG") for number in range(1, 5)]
    found = find_masks(photographs, mask_files(folder))
    assert {photograph.name: mask.name for photograph, mask in found.items()} == {
        "DJI_0001.JPG": "DJI_0001.png",
        "DJI_0002.JPG": "dji_0002_mask.JPG",
        "DJI_0003.JPG": "DJI_0003.JPG.png",
    }


def test_what_cannot_be_meant_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no mask is named like"):
        find_masks([Path("other.jpg")], mask_files(folder))
    Image.new("L", (8, 6)).save(folder / "DJI_0001_mask.png")
    with pytest.raises(InputError, match="two masks"):
        find_masks([Path("DJI_0001.JPG")], mask_files(folder))
    with pytest.raises(InputError, match="doesn't exist"):
        mask_files(tmp_path / "nowhere")


def test_black_is_not_used_and_small_masks_are_scaled(tmp_path: Path) -> None:
    pixels = np.full((3, 4), 255, np.uint8)
    pixels[:, 0] = 40
    Image.fromarray(pixels).save(tmp_path / "m.png")
    used = read_mask(tmp_path / "m.png", 400, 300)
    assert used.shape == (300, 400)
    assert not used[:, :100].any()
    assert used[:, 100:].all()
    with pytest.raises(InputError, match="another shape"):
        read_mask(tmp_path / "m.png", 300, 400)
    (tmp_path / "m.png").write_text("no picture")
    with pytest.raises(InputError, match="can't be read"):
        read_mask(tmp_path / "m.png", 400, 300)
