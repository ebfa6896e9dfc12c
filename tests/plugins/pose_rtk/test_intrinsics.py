import math
from pathlib import Path
from typing import Any

import pytest

from slideframe.errors import InputError
from slideframe_pose_rtk.intrinsics import camera_of
from slideframe_pose_rtk.metadata import LensCalibration, PhotoRecord

DEWARP = LensCalibration(
    focal_x=3700.0, focal_y=3710.0, center_x=-12.0, center_y=8.0, distortion=(-0.1, 0.02, 0.001, -0.002, -0.01)
)
FULL = (5280, 3956)


def record(**changes: Any) -> PhotoRecord:
    fields: dict[str, Any] = {"path": Path("a.jpg"), "size": FULL, "full_size": FULL, "focal_length_35mm": 24.0}
    return PhotoRecord(**(fields | changes))


def test_measured_calibration_comes_first_and_scales_with_the_picture() -> None:
    full, how = camera_of(record(dewarp=DEWARP, calibrated_focal_length=3725.0))
    half, _ = camera_of(record(dewarp=DEWARP, size=(2640, 1978)))
    assert how == "measured"
    assert (full.focal_x, full.principal_x, full.principal_y) == (3700.0, 2628.0, 1986.0)
    assert (half.focal_x, half.focal_y, half.principal_x, half.principal_y) == (1850.0, 1855.0, 1314.0, 993.0)
    assert half.distortion == full.distortion == DEWARP.distortion


def test_dewarped_pictures_have_no_distortion_left() -> None:
    camera, _ = camera_of(record(dewarp=DEWARP, is_dewarped=True))
    assert not any(camera.distortion)


def test_design_value_where_nothing_is_measured() -> None:
    camera, how = camera_of(record(calibrated_focal_length=3725.0, optical_center=(2640.0, 1978.0), size=(1320, 989)))
    assert how == "design"
    assert (camera.focal_x, camera.principal_x, camera.principal_y) == (931.25, 660.0, 494.5)


def test_size_rewritten_by_a_program_is_found_out_by_the_design_centre() -> None:
    resized = record(dewarp=DEWARP, size=(1320, 989), full_size=(1320, 989), optical_center=(2640.0, 1978.0))
    assert camera_of(resized)[0].focal_x == pytest.approx(3700 / 4)


def test_a_crop_falls_back_to_the_equivalent_focal_length() -> None:
    camera, how = camera_of(record(dewarp=DEWARP, size=(2000, 2000)))
    assert how == "nominal"
    # CIPA DCG-001: the diagonal of 36 x 24 mm sees what the picture's diagonal sees
    assert camera.focal_x == pytest.approx(24.0 / math.hypot(36, 24) * math.hypot(2000, 2000))


def test_no_focal_length_at_all() -> None:
    with pytest.raises(InputError, match="no focal length") as caught:
        camera_of(record(focal_length_35mm=None))
    assert "a.jpg" in str(caught.value)


def test_pix4ds_tags_are_of_the_type_and_scale() -> None:
    lens = LensCalibration(
        focal_x=3600.0, focal_y=3600.0, center_x=4.0, center_y=-6.0, distortion=(0.1, 0.0, 0.0, 0.0, 0.0)
    )
    camera, how = camera_of(record(stated_lens=lens, calibrated_focal_length=3725.0, size=(2640, 1978)))
    assert how == "design"
    assert (camera.focal_x, camera.principal_x, camera.principal_y) == (1800.0, 1322.0, 986.0)
    assert camera.distortion == lens.distortion


@pytest.mark.parametrize(("pitch", "focal_length"), [(0.00333, 12.29 / 0.00333), (0.02, None), (None, None)])
def test_the_sensors_pixels_refine_the_equivalent_unless_they_contradict_it(
    pitch: float | None, focal_length: float | None
) -> None:
    """Sequoia and others state the pixel pitch; the equivalent is rounded to a millimetre."""
    camera, how = camera_of(record(focal_length=12.29, pixel_pitch=pitch))
    equivalent = 24.0 / math.hypot(36, 24) * math.hypot(*FULL)
    assert how == "nominal"
    assert camera.focal_x == pytest.approx(focal_length or equivalent)


def test_the_pixel_pitch_is_of_the_full_picture() -> None:
    camera, _ = camera_of(record(focal_length=12.29, pixel_pitch=0.00333, focal_length_35mm=None, size=(1320, 989)))
    assert camera.focal_x == pytest.approx(12.29 / 0.00333 / 4)
