from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from slideframe.quality.pictures import LEAST_SHARPNESS, inspect_picture


def moved(picture: Image.Image, length: int) -> Image.Image:
    """Blur along rows by `length` px, as the drone's motion does, then add the sensor's noise."""
    gray = np.asarray(picture.convert("L"), np.float32)
    smeared = sum(np.roll(gray, step, axis=1) for step in range(length)) / length
    noisy = smeared + np.random.default_rng(0).normal(0, 1.5, gray.shape)
    return Image.fromarray(np.clip(noisy, 0, 255).astype(np.uint8))


@pytest.fixture(scope="module")
def ground() -> Image.Image:
    """Fractal noise with the fall of detail that natural pictures have, 1600 px wide."""
    generator = np.random.default_rng(5)
    rows, columns = np.meshgrid(np.fft.fftfreq(1200), np.fft.rfftfreq(1600), indexing="ij")
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = 1.0
    spectrum = np.exp(2j * np.pi * generator.random(frequency.shape)) / frequency**1.1
    spectrum[0, 0] = 0
    values = np.fft.irfft2(spectrum, (1200, 1600))
    return Image.fromarray(np.clip(110 + 45 * values / values.std(), 0, 255).astype(np.uint8))


def test_a_sharp_picture_has_no_fault(ground: Image.Image) -> None:
    assert inspect_picture(ground).fault is None
    assert inspect_picture(ground.convert("RGB")).sharpness > LEAST_SHARPNESS + 0.1


@pytest.mark.parametrize("radius", [2, 3, 6])
def test_blur_is_found(ground: Image.Image, radius: int) -> None:
    assert inspect_picture(ground.filter(ImageFilter.GaussianBlur(radius))).fault == "blurred"


@pytest.mark.parametrize("length", [6, 8, 12, 20])
def test_motion_is_found_though_it_leaves_one_direction_sharp(ground: Image.Image, length: int) -> None:
    assert inspect_picture(moved(ground, length)).fault == "blurred"


def test_darkness_with_noise_is_a_covered_lens() -> None:
    noise = np.random.default_rng(1).normal(3, 1.5, (600, 800))
    assert inspect_picture(Image.fromarray(np.clip(noise, 0, 255).astype(np.uint8))).fault == "covered"


def test_a_picture_of_a_few_pixels_is_measured_too() -> None:
    inspect_picture(Image.new("RGB", (7, 5)))
    inspect_picture(Image.new("RGB", (64, 48)))


def test_real_faulty_photographs(shared: Path) -> None:
    folder = shared / "data/metadata_samples/bad_images"
    found = {path.name: inspect_picture(Image.open(path)).fault for path in folder.glob("*.JPG")}
    assert len(found) == 3
    for name, fault in found.items():
        assert fault == ("covered" if "LENS_CAP" in name else "blurred"), name


def test_real_good_photographs_and_the_same_ones_blurred(shared: Path) -> None:
    paths = sorted((shared / "data/uav/mirafiori_rtk/images").glob("*.JPG"))[::6]
    for path in paths:
        picture = Image.open(path)
        assert inspect_picture(picture).sharpness > LEAST_SHARPNESS + 0.1, path.name
    assert inspect_picture(picture.filter(ImageFilter.GaussianBlur(2))).fault == "blurred"
    for length in (5, 12, 20):
        assert inspect_picture(moved(picture, length)).fault == "blurred"
