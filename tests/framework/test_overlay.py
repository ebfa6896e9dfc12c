"""Time, scale bar and legend."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.overlay import INK, Overlay, round_length
from slideframe.problem.camera_path import look_at, pinhole

CAMERA = pinhole(640, 360, 60.0)
POSE = look_at(np.array([0.0, -80.0, 30.0]), np.zeros(3))
GREY = np.full((360, 640, 3), 90, np.uint8)


def test_the_bar_is_as_long_as_it_says_where_the_target_is():
    marked = Overlay((), np.zeros(3)).on(GREY, 1.5, CAMERA, POSE)
    bar = marked[350]
    white = np.flatnonzero((bar == INK).all(axis=1))
    depth = np.hypot(80, 30)
    length = (white[-1] - white[0] + 1) * depth / CAMERA.focal_x
    assert length == pytest.approx(20, rel=0.02)  # 1, 2 or 5 times a power of ten, at most a quarter of the picture


def test_time_and_legend_stand_where_they_should_and_the_picture_is_untouched_elsewhere():
    before = GREY.copy()
    marked = Overlay(("sand, 2000 kg/m3", "simulated"), np.zeros(3)).on(GREY, 1.5, CAMERA, POSE)
    changed = (marked != GREY).any(axis=2)
    assert changed[:30, :150].any()
    assert changed[-50:, :200].any()
    assert not changed[60:280].any()
    np.testing.assert_array_equal(GREY, before)
    later = Overlay(("sand, 2000 kg/m3", "simulated"), np.zeros(3)).on(GREY, 2.5, CAMERA, POSE)
    assert (later[:30, :150] != marked[:30, :150]).any()
    np.testing.assert_array_equal(later[60:], marked[60:])


def test_there_is_no_bar_for_what_lies_behind_the_camera():
    behind = Overlay((), np.array([0.0, -200.0, 0.0])).on(GREY, 0.0, CAMERA, POSE)
    assert (behind[200:] == GREY[200:]).all()


@given(st.floats(1e-3, 1e5))
def test_a_round_length_is_the_longest_that_fits(longest):
    found = round_length(longest)
    assert found <= longest * (1 + 1e-9) < found * 2.5 + 1e-9
    assert f"{found:.0e}"[0] in "125"
