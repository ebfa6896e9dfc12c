"""Splats through every form of file."""

import sys

import numpy as np
import pytest

from slideframe.errors import InputError, MissingDependency
from slideframe.formats.splat_file import read_splats, write_splats
from slideframe.products import SplatCloud

# What the forms keep, by their own quantisation: positions in metres for a scene of 100 m, logarithms of scales,
# opacities, coefficients of harmonics, and the sine of half the angle between rotations.
KEPT = {
    "splats.ply": {"centers": 1e-7, "log_scales": 1e-6, "opacities": 1e-5, "harmonics": 1e-7, "turn": 1e-3},
    "splats.spz": {"centers": 1.3e-4, "log_scales": 1 / 32, "opacities": 1 / 500, "harmonics": 0.065, "turn": 3e-3},
    "splats.compressed.ply": {
        "centers": 0.06,
        "log_scales": 0.01,
        "opacities": 1 / 500,
        "harmonics": 0.02,
        "turn": 2e-3,
    },
}


def cloud(coefficients: int) -> SplatCloud:
    """Return 500 splats over 100 m, strewn so that the 256 of one chunk of a compressed file span 50 m."""
    random = np.random.default_rng(coefficients)
    rotations = random.normal(size=(500, 4))
    return SplatCloud(
        centers=random.uniform(-50, 50, (500, 3)).astype(np.float32),
        rotations=(rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(random.uniform(-5, 0, (500, 3))).astype(np.float32),
        opacities=random.uniform(0.05, 0.95, 500).astype(np.float32),
        harmonics=random.uniform(-0.9, 0.9, (500, coefficients, 3)).astype(np.float32),
    )


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
@pytest.mark.parametrize("name", KEPT)
def test_splats_come_back_as_the_form_keeps_them(name, coefficients, tmp_path):
    if name != "splats.ply":
        pytest.importorskip("gsply", reason="compressed splats need gsply")
    written = cloud(coefficients)
    write_splats(written, tmp_path / name)
    read = read_splats(tmp_path / name)
    # a compressed file is sorted along a space-filling curve
    order = np.argmin(np.linalg.norm(read.centers[:, None] - written.centers[None], axis=2), axis=0)
    assert len(set(order)) == len(written)
    kept = KEPT[name]
    np.testing.assert_allclose(read.centers[order], written.centers, atol=kept["centers"])
    np.testing.assert_allclose(np.log(read.scales[order]), np.log(written.scales), atol=kept["log_scales"])
    np.testing.assert_allclose(read.opacities[order], written.opacities, atol=kept["opacities"])
    assert read.harmonics.shape == written.harmonics.shape
    np.testing.assert_allclose(read.harmonics[order], written.harmonics, atol=kept["harmonics"])
    cosine = np.abs((read.rotations[order].astype(np.float64) * written.rotations).sum(axis=1)).clip(max=1)
    assert np.sqrt(1 - cosine**2).max() <= kept["turn"]


@pytest.mark.parametrize("name", ["damaged.ply", "damaged.spz", "damaged.compressed.ply", "splats.splat"])
def test_other_files_are_refused_by_name(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(b"something else entirely" * 10)
    with pytest.raises(InputError, match=name):
        read_splats(path)


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gsply", None)
    with pytest.raises(MissingDependency, match=r"slideframe\[compressed\]"):
        write_splats(cloud(1), tmp_path / "splats.spz")
