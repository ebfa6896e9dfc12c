from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.photographs import distort
from slideframe.products import Camera, Georeference
from slideframe.stages import Context
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.intrinsics import turned_camera
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.orientation import about_up, world_from_camera
from slideframe_pose_rtk.turned import twist_and_tilt, warn_of_turned


@given(st.floats(-180, 180), st.floats(-100, 10), st.floats(-20, 20), st.sampled_from([-90.0, 0.0, 3.0, 90.0, 179.0]))
def test_a_turn_about_the_line_of_sight(yaw: float, pitch: float, roll: float, turn: float) -> None:
    stated = world_from_camera(yaw, pitch, roll)
    (twist,), (tilt,) = twist_and_tilt(stated[None], (stated @ about_up(turn))[None])  # the camera's z looks ahead
    assert twist == pytest.approx(turn, abs=1e-9)
    assert tilt == pytest.approx(0.0, abs=1e-5)


def test_a_tilt_is_no_turn() -> None:
    stated, found = world_from_camera(40.0, -90.0, 0.0), world_from_camera(40.0, -60.0, 0.0)
    (twist,), (tilt,) = twist_and_tilt(stated[None], found[None])
    assert twist == pytest.approx(0.0, abs=1e-9)
    assert tilt == pytest.approx(30.0)


@given(st.integers(0, 3), st.floats(-0.6, 0.6), st.floats(-0.45, 0.45))
def test_a_turned_camera_sees_the_turned_picture(quarters: int, x: float, y: float) -> None:
    """The turn of the axes is the one that `twist` measures, and the pixel is where turning the picture puts it."""
    camera = Camera(
        width=800, height=600, focal_x=700.0, focal_y=690.0, principal_x=415.0, principal_y=289.0,
        distortion=(-0.11, 0.02, 2e-3, -3e-3, 0.01),
    )  # fmt: skip
    turned = turned_camera(camera, quarters)

    def pixel(lens: Camera, ray: np.ndarray) -> np.ndarray:
        slopes = distort(ray[None, :2] / ray[2], lens.distortion)[0]
        return slopes * [lens.focal_x, lens.focal_y] + [lens.principal_x, lens.principal_y]

    ray = np.array([x, y, 1.0])
    column, row = pixel(camera, ray)
    expected = [(column, row), (row, 800 - column), (800 - column, 600 - row), (600 - row, column)][quarters]
    np.testing.assert_allclose(pixel(turned, about_up(90.0 * quarters).T @ ray), expected, atol=1e-9)
    assert (turned.width, turned.height) == ((600, 800) if quarters % 2 else (800, 600))


def test_the_contradicting_are_named(context: Context) -> None:
    stated = world_from_camera(20.0, -80.0, 0.0)
    found = {
        "fine": stated @ about_up(4.0),
        "upside_down": stated @ about_up(178.0),
        "on_its_side": stated @ about_up(91.0),
        "elsewhere": world_from_camera(20.0, -30.0, 0.0),
        "between": stated @ about_up(45.0),
        "unknown": np.eye(3),
    }
    flight = Flight(
        folder=Path(),
        records=tuple(PhotoRecord(path=Path(f"{name}.jpg"), size=(4, 3)) for name in found),
        georeference=Georeference(latitude=0.0, longitude=0.0, ellipsoidal_height=0.0),
        cameras=(),
        calibrations=(),
        camera_of=(),
        positions=np.zeros((6, 3)),
        position_sigma=np.ones((6, 3)),
        rotations=np.array([stated] * 5 + [np.eye(3)]),
        oriented=np.array([True] * 5 + [False]),
    )
    poses = {index: np.column_stack([rotation, np.zeros(3)]) for index, rotation in enumerate(found.values())}
    warn_of_turned(flight, poses, context)
    sideways, over, otherwise = context.warnings
    assert "turned by 90 degrees" in sideways
    assert sideways.endswith(": on_its_side.jpg")
    assert "turned by 180 degrees" in over
    assert over.endswith(": upside_down.jpg")
    assert otherwise.endswith(": elsewhere.jpg, between.jpg")
