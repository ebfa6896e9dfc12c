from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe_pose_rtk.calibration import calibrated, read_calibration
from slideframe_pose_rtk.intrinsics import camera_of
from slideframe_pose_rtk.metadata import LensCalibration, PhotoRecord

MEASURED = LensCalibration(focal_x=1.0, focal_y=1.0, center_x=0.0, center_y=0.0, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))


def record(model: str = "M3E", serial: str = "A", size: tuple[int, int] = (2640, 1978)) -> PhotoRecord:
    return PhotoRecord(path=Path(f"{model}{serial}.jpg"), size=size, model=model, serial=serial, dewarp=MEASURED)


def write(folder: Path, text: str) -> Path:
    path = folder / "cameras.toml"
    path.write_text(text)
    return path


FULL = """
[[camera]]
model = "M3E"
serial = "A"
width = 5280
height = 3956
focal_x = 3713.0
focal_y = 3711.0
principal_x = 2647.0
principal_y = 1969.0
distortion = [-0.1, 0.01, 0.001, -0.002, -0.03]

[[camera]]
model = "M3E"
width = 5280
height = 3956
focal_x = 3700.0
"""


def test_the_table_that_says_most_wins_and_scales(tmp_path: Path) -> None:
    path = write(tmp_path, FULL)
    first, second, third = calibrated([record(), record(serial="B"), record("P1")], read_calibration(path), path)
    camera, source = camera_of(first)
    assert source == "user"
    assert (camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y) == (1856.5, 1855.5, 1323.5, 984.5)
    assert camera.distortion == (-0.1, 0.01, 0.001, -0.002, -0.03)
    assert (camera.width, camera.height) == (2640, 1978)
    plain, _ = camera_of(second)
    assert (plain.focal_x, plain.focal_y, plain.principal_x, plain.principal_y) == (1850.0, 1850.0, 1320.0, 989.0)
    assert camera_of(third)[1] == "measured", "other cameras keep what their files say"


def test_a_picture_of_another_shape(tmp_path: Path) -> None:
    path = write(tmp_path, FULL)
    with pytest.raises(InputError, match=r"1000 x 1000 px, and its calibration is for 5280 x 3956 px"):
        calibrated([record(size=(1000, 1000))], read_calibration(path), path)


def test_a_calibration_of_other_cameras_only(tmp_path: Path) -> None:
    path = write(tmp_path, FULL)
    with pytest.raises(InputError, match="no photograph is of a camera") as caught:
        calibrated([record("P1", "Z")], read_calibration(path), path)
    assert "'P1' (serial 'Z')" in caught.value.cure


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "camera: "),
        ("[[camera]]\nwidth = 4\nheight = 3\n", "camera.0.focal_x"),
        ("[[camera]]\nwidth = 4\nheight = 3\nfocal_x = -1\n", "camera.0.focal_x"),
        ("[[camera]]\nwidth = 4\nheight = 3\nfocal_x = 1\nfocal = 2\n", "camera.0.focal"),
        ("[[camera]\n", "can't be read"),
    ],
)
def test_what_cannot_be_meant(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        read_calibration(write(tmp_path, text))
    assert "cameras.toml" in str(caught.value)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="can't be read"):
        read_calibration(tmp_path / "absent.toml")
