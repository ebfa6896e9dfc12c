"""Splats survive the trip through a PLY file."""

import re

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.formats.splat_ply import read_splat_ply, write_splat_ply
from slideframe.products import SplatCloud

# float32 logarithms and logits and back
ROUND_TRIP = 2e-6


def cloud(count: int = 7, coefficients: int = 16) -> SplatCloud:
    random = np.random.default_rng(3)
    rotations = random.normal(size=(count, 4))
    return SplatCloud(
        centers=random.normal(size=(count, 3)).astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=random.uniform(0.01, 2, (count, 3)).astype(np.float32),
        opacities=random.uniform(0.01, 0.99, count).astype(np.float32),
        harmonics=random.normal(size=(count, coefficients, 3)).astype(np.float32),
    )


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_round_trip(tmp_path, coefficients):
    splats = cloud(coefficients=coefficients)
    write_splat_ply(splats, tmp_path / "splats.ply")
    found = read_splat_ply(tmp_path / "splats.ply")
    for name in SplatCloud.array_fields():
        np.testing.assert_allclose(
            getattr(found, name), getattr(splats, name), rtol=ROUND_TRIP, atol=1e-6, err_msg=name
        )


def test_layout_is_that_of_splat_viewers(tmp_path):
    """Column order of Kerbl et al.'s writer; the rest of the harmonics goes channel by channel."""
    splats = cloud(2, 4)
    path = tmp_path / "splats.ply"
    write_splat_ply(splats, path)
    header, body = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[2].decode() for line in header.splitlines() if line.startswith(b"property")]
    rest = [f"f_rest_{i}" for i in range(9)]
    scales, rotations = ["scale_0", "scale_1", "scale_2"], ["rot_0", "rot_1", "rot_2", "rot_3"]
    directions = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names == [*directions, *rest, "opacity", *scales, *rotations]
    table = np.frombuffer(body, "<f4").reshape(2, -1)
    np.testing.assert_array_equal(table[:, names.index("f_rest_3")], splats.harmonics[:, 1, 1])
    np.testing.assert_allclose(table[:, names.index("scale_1")], np.log(splats.scales[:, 1]), rtol=ROUND_TRIP)


def test_full_and_empty_opacity_stay_finite(tmp_path):
    splats = cloud(2)
    splats = splats.model_copy(update={"opacities": np.array([0, 1], np.float32)})
    write_splat_ply(splats, tmp_path / "splats.ply")
    np.testing.assert_allclose(read_splat_ply(tmp_path / "splats.ply").opacities, [0, 1], atol=ROUND_TRIP)


def cut_short(data: bytes) -> bytes:
    return data[:-5]


def ascii_format(data: bytes) -> bytes:
    return data.replace(b"binary_little_endian", b"ascii")


def without_opacity(data: bytes) -> bytes:
    return data.replace(b"opacity", b"opaque")


def named_twice(data: bytes) -> bytes:
    return data.replace(b"property float nx", b"property float x")


def without_count(data: bytes) -> bytes:
    return data.replace(b"element vertex ", b"element vertex -")


def without_splats(data: bytes) -> bytes:
    return re.sub(rb"element vertex \d+", b"element vertex 0", data)


@pytest.mark.parametrize(
    "damage", [cut_short, ascii_format, without_opacity, named_twice, without_count, without_splats]
)
def test_other_files_are_refused_by_name(tmp_path, damage):
    path = tmp_path / "splats.ply"
    write_splat_ply(cloud(), path)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=r"splats\.ply"):
        read_splat_ply(path)


def test_splats_that_are_no_numbers_are_left_out_with_a_warning(tmp_path, caplog):
    """Trainers of other programs export a few."""
    splats, path = cloud(), tmp_path / "splats.ply"
    write_splat_ply(splats, path)
    data = path.read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    table = np.frombuffer(data[body:], "<f4").reshape(len(splats), -1).copy()
    table[0, 0], table[2, -4:], table[3, -5] = np.nan, 0, 1000  # a place, a quaternion, the logarithm of a scale
    path.write_bytes(data[:body] + table.tobytes())
    np.testing.assert_array_equal(read_splat_ply(path).centers, np.delete(splats.centers, [0, 2, 3], axis=0))
    assert f"3 of {len(splats)} splats are left out" in caplog.text
    path.write_bytes(data[:body] + np.full_like(table, np.nan).tobytes())
    with pytest.raises(InputError, match="none of its"):
        read_splat_ply(path)
