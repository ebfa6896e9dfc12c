import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe_pose_rtk.orientation import about_up, angle_between, world_from_camera, yaw_bias

GOLDEN_DIGITS = 1e-9  # the golden vectors are printed to nine decimals
ROUNDING = 1e-12
angles = st.floats(-180, 180)


def test_golden_vectors(shared: Path) -> None:
    vectors = json.loads((shared / "data" / "golden_pose_vectors.json").read_text())
    assert vectors
    for vector in vectors:
        rotation = world_from_camera(vector["yaw"], vector["pitch"], vector["roll"])
        np.testing.assert_allclose(rotation.T, vector["R_cam_from_world"], atol=GOLDEN_DIGITS, rtol=0)


# Optical axis and picture's right in east-north-up, from the meaning of the angles: compass heading, elevation.
@pytest.mark.parametrize("heading", [0.0, 37.0, 90.0, 143.0, 200.0, 305.0])
@pytest.mark.parametrize("elevation", [-90.0, -60.0, -35.0, 0.0])
def test_looks_along_heading_and_elevation(heading: float, elevation: float) -> None:
    rotation = world_from_camera(heading, elevation, 0.0)
    h, e = np.radians([heading, elevation])
    forward = [np.sin(h) * np.cos(e), np.cos(h) * np.cos(e), np.sin(e)]
    np.testing.assert_allclose(rotation[:, 2], forward, atol=ROUNDING)
    np.testing.assert_allclose(rotation[:, 0], [np.cos(h), -np.sin(h), 0.0], atol=ROUNDING)


@given(angles, angles, angles)
def test_is_a_rotation(yaw: float, pitch: float, roll: float) -> None:
    rotation = world_from_camera(yaw, pitch, roll)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize(("first", "second"), [((30, -90, 180), (210, -90, 0)), ((210, -80, 180), (30, -100, 0))])
def test_past_nadir_and_turned_over(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    np.testing.assert_allclose(world_from_camera(*first), world_from_camera(*second), atol=ROUNDING)


@given(st.floats(-170, 170), st.lists(st.tuples(angles, angles), min_size=1, max_size=5))
def test_yaw_bias_is_recovered(bias: float, gimbals: list[tuple[float, float]]) -> None:
    stated = np.array([world_from_camera(yaw, pitch, 0.0) for yaw, pitch in gimbals])
    measured = about_up(bias) @ stated
    assert yaw_bias(measured, stated) == pytest.approx(bias, abs=1e-9)
    np.testing.assert_allclose(angle_between(measured, stated), abs(bias), atol=1e-9)
