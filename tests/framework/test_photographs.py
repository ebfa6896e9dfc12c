"""Photographs come back as a pinhole would have taken them."""

import numpy as np
import pytest
from PIL import Image

from slideframe.errors import InputError
from slideframe.photographs import distort, load_photograph
from slideframe.products import Camera, Georeference, Photograph, Survey

# Levels of 256: rounding to whole levels twice, and bilinear interpolation of waves of some 40 px
MEAN_LEVEL_ERROR = 2.0
DISTORTION = (-0.25, 0.12, 0.002, -0.001, -0.03)


def camera(distortion=(0.0, 0.0, 0.0, 0.0, 0.0)) -> Camera:
    return Camera(
        width=120, height=90, focal_x=100.0, focal_y=102.0, principal_x=63.0, principal_y=42.0, distortion=distortion
    )


def survey(path, lens: Camera) -> Survey:
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(lens,),
        photographs=(Photograph(path=path, camera=0, sha256=""),),
        world_from_camera=np.eye(4)[None, :3],
        position_sigma=np.ones((1, 3)),
        sparse_points=np.empty((0, 3), np.float32),
        sparse_colors=np.empty((0, 3), np.uint8),
        sparse_errors=np.empty(0, np.float32),
    )


def wavy(slopes: np.ndarray) -> np.ndarray:
    """A smooth picture painted on the plane z = 1."""
    x, y = slopes[..., 0], slopes[..., 1]
    return np.stack([np.sin(14 * x), np.cos(11 * y), np.sin(9 * (x + y))], axis=-1) * 100 + 128


def pixel_slopes(lens: Camera) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    return np.stack([(columns - lens.principal_x) / lens.focal_x, (rows - lens.principal_y) / lens.focal_y], axis=-1)


def undistorted_slopes(lens: Camera) -> np.ndarray:
    """Invert the lens by fixed-point iteration, independently of the code under test's direction."""
    wanted = pixel_slopes(lens)
    found = wanted.copy()
    for _ in range(60):
        found += wanted - distort(found, lens.distortion)
    return found


def test_lens_model_is_opencvs():
    """Numbers by hand: r^2 = 0.05 at (0.1, 0.2)."""
    radial = 1 - 0.25 * 0.05 + 0.12 * 0.05**2 - 0.03 * 0.05**3
    x = 0.1 * radial + 2 * 0.002 * 0.02 - 0.001 * (0.05 + 0.02)
    y = 0.2 * radial + 0.002 * (0.05 + 0.08) - 2 * 0.001 * 0.02
    np.testing.assert_allclose(distort(np.array([0.1, 0.2]), DISTORTION), [x, y], rtol=1e-14)


def test_undistorts_to_the_pinhole(tmp_path):
    lens = camera(DISTORTION)
    taken = wavy(undistorted_slopes(lens)).astype(np.uint8)
    Image.fromarray(taken).save(tmp_path / "photo.png")
    pixels, pinhole, mask = load_photograph(survey(tmp_path / "photo.png", lens), 0)
    assert pinhole == camera()
    seen = np.ones(pixels.shape[:2], bool) if mask is None else mask
    error = np.abs(pixels.astype(float) - wavy(pixel_slopes(pinhole)))[seen]
    assert error.mean() < MEAN_LEVEL_ERROR
    assert np.abs(taken.astype(float) - wavy(pixel_slopes(pinhole))).mean() > 4 * MEAN_LEVEL_ERROR


def test_mask_marks_what_the_lens_did_not_see(tmp_path):
    lens = camera((0.4, 0.0, 0.0, 0.0, 0.0))
    Image.new("RGB", (120, 90), (9, 9, 9)).save(tmp_path / "photo.png")
    _, _, mask = load_photograph(survey(tmp_path / "photo.png", lens), 0)
    assert not mask[0, 0]
    assert mask[42, 63]


@pytest.mark.parametrize("distortion", [(0.0,) * 5, DISTORTION], ids=["pinhole", "lens"])
def test_a_mask_is_undistorted_with_its_photograph(tmp_path, distortion):
    """A photograph that is white where its mask is: the two stay together but for the edge's interpolation."""
    drawn = np.zeros((90, 120), np.uint8)
    drawn[20:60, 30:100] = 255
    Image.fromarray(np.repeat(drawn[..., None], 3, axis=2)).save(tmp_path / "photo.png")
    Image.fromarray(drawn).save(tmp_path / "mask.png")
    one = survey(tmp_path / "photo.png", camera(distortion))
    photograph = one.photographs[0].model_copy(update={"mask": tmp_path / "mask.png"})
    masked = one.model_copy(update={"photographs": (photograph, *one.photographs[1:])})
    pixels, _, used = load_photograph(masked, 0)
    assert np.abs(pixels[..., 0].astype(int) - 255 * used)[1:-1, 1:-1].mean() < 3
    assert 0.2 < used.mean() < 0.5
    _, _, small = load_photograph(masked, 0, width=60)
    assert small.shape == (45, 60)
    assert small.mean() == pytest.approx(used.mean(), abs=0.02)


def test_reduces_by_area_with_its_camera(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "photo.png")
    reduced, lens, mask = load_photograph(survey(tmp_path / "photo.png", camera()), 0, width=60)
    blocks = pixels.reshape(45, 2, 60, 2, 3).mean(axis=(1, 3))
    assert np.abs(reduced - blocks).max() <= 1
    assert (lens.width, lens.height, lens.focal_x, lens.principal_y) == (60, 45, 50.0, 21.0)
    assert mask is None


def test_wider_than_the_photograph_is_the_photograph(tmp_path):
    Image.new("RGB", (120, 90)).save(tmp_path / "photo.png")
    assert load_photograph(survey(tmp_path / "photo.png", camera()), 0, width=4000)[1] == camera()


@pytest.mark.parametrize("kind", ["missing", "truncated", "no picture", "other size"])
def test_bad_files_are_named(tmp_path, kind):
    path = tmp_path / "DJI_0001.JPG"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)).save(path)
    if kind == "missing":
        path.unlink()
    elif kind == "truncated":
        path.write_bytes(path.read_bytes()[:3000])
    elif kind == "no picture":
        path.write_bytes(b"not a picture")
    else:
        Image.new("RGB", (121, 90)).save(path)
    with pytest.raises(InputError, match=r"DJI_0001\.JPG"):
        load_photograph(survey(path, camera()), 0)
