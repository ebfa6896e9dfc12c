"""Frames in sixteen bits: the error is the one that is stated."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe import compact
from slideframe.products import ParticleFrame
from slideframe.store import Store, read_product, write_product


def frame(seed=0, count=500, extent=1000.0):
    random = np.random.default_rng(seed)
    return ParticleFrame(
        time=0.25,
        positions=(extent * random.random((count, 3)) - [extent / 2, 0, 3]).astype(np.float32),
        velocities=(30 * random.standard_normal((count, 3))).astype(np.float32),
        deformation_gradients=(np.eye(3) + 0.3 * random.standard_normal((count, 3, 3))).astype(np.float32),
        escaped=3,
    )


def size(folder):
    return sum(path.stat().st_size for path in folder.rglob("*.npy"))


def test_a_frame_comes_back_within_the_stated_error_in_half_the_space(tmp_path):
    whole = frame(count=20_000)
    write_product(tmp_path / "whole", whole)
    write_product(tmp_path / "compact", whole, compactly=True)
    back = read_product(tmp_path / "compact", ParticleFrame)
    assert (back.time, back.escaped) == (0.25, 3)
    bound = compact.largest_error(whole.positions)
    assert bound == pytest.approx(1000 / 65535 / 2, rel=1e-3)
    # and the rounding of float32 at 500 m
    assert np.abs(back.positions.astype(np.float64) - whole.positions).max() <= bound + 3.1e-5
    for name in ("velocities", "deformation_gradients"):
        mine, theirs = getattr(back, name).astype(np.float64), getattr(whole, name)
        assert (np.abs(mine - theirs) <= 2**-11 * np.abs(theirs) + 3e-8).all()
        assert (mine != theirs).any()
    assert size(tmp_path / "compact") <= 0.51 * size(tmp_path / "whole")


@settings(max_examples=50)
@given(
    low=st.floats(-1e4, 1e4, width=32),
    extents=st.tuples(*[st.floats(0, 1e4, width=32)] * 3),
    count=st.integers(0, 20),
    seed=st.integers(0, 99),
)
def test_positions_in_any_box_keep_to_half_a_step(tmp_path_factory, low, extents, count, seed):
    folder = tmp_path_factory.mktemp("compact")
    values = (low + np.random.default_rng(seed).random((count, 3)) * extents).astype(np.float32)
    compact.write(folder, "positions", values, "fixed")
    back = compact.read(folder, "positions")
    assert back.dtype == np.float32
    assert back.shape == values.shape
    error = np.abs(back.astype(np.float64) - values).max(initial=0.0)
    assert error <= compact.largest_error(values) + np.spacing(np.abs(values).max(initial=0.0))


def test_what_sixteen_bits_cannot_hold_is_refused(tmp_path):
    with pytest.raises(ValueError, match="velocities reach 70000"):
        compact.write(tmp_path, "velocities", np.float32([[7e4, 0, 0]]), "half")


def test_a_whole_frame_is_not_compact(tmp_path):
    write_product(tmp_path / "whole", frame())
    assert compact.read(tmp_path / "whole", "positions") is None
    assert read_product(tmp_path / "whole", ParticleFrame) == frame()


def test_a_stream_may_be_compact(tmp_path):
    entry = Store(tmp_path).entry("solver", "k")
    entry.write_stream((frame(index) for index in range(3)), dict, compactly=True)
    assert len(entry.read(ParticleFrame)) == 3
    assert (entry.folder / "000001" / "velocities.half.npy").is_file()
