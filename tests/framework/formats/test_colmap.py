from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.errors import InputError
from slideframe.formats.colmap import quaternion_of, read_colmap_text, rotation_of, write_colmap_text
from slideframe.products import Survey

ROUNDING = 1e-12
COUNT = 4


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_quaternions_and_rotations_are_the_same(values: list[float]) -> None:
    unit = np.array(values) / np.linalg.norm(values)
    back = quaternion_of(rotation_of(unit))
    assert abs(back @ unit) == pytest.approx(1.0, abs=ROUNDING)
    np.testing.assert_allclose(rotation_of(back), rotation_of(unit), atol=ROUNDING)


def test_round_trip(survey: Survey, tmp_path: Path) -> None:
    write_colmap_text(survey, tmp_path / "model")
    back = read_colmap_text(tmp_path / "model", tmp_path / "photographs", survey.georeference)
    np.testing.assert_allclose(back.world_from_camera, survey.world_from_camera, atol=1e-11)
    assert back == survey.model_copy(update={"world_from_camera": back.world_from_camera}), "all else bit for bit"


def test_colmap_reads_the_same(survey: Survey, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    write_colmap_text(survey, tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    assert model.num_reg_images() == COUNT
    for number, photograph in enumerate(survey.photographs, 1):
        image = model.image(number)
        assert tmp_path / "photographs" / image.name == photograph.path
        pose = survey.world_from_camera[number - 1]
        np.testing.assert_allclose(image.cam_from_world().inverse().matrix(), pose, atol=1e-11)
        camera = survey.cameras[photograph.camera]
        params = model.camera(image.camera_id).params
        np.testing.assert_array_equal(
            params[:4], [camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y]
        )
        np.testing.assert_array_equal(params[4:9], camera.distortion[: len(params[4:9])])
    for number, place in enumerate(survey.sparse_points, 1):
        np.testing.assert_array_equal(model.point3D(number).xyz, place.astype(np.float64))
        np.testing.assert_array_equal(model.point3D(number).color, survey.sparse_colors[number - 1])


def test_names_that_colmap_would_cut_are_refused(survey: Survey, tmp_path: Path) -> None:
    spaced = survey.photographs[0].model_copy(update={"path": tmp_path / "photographs" / "a 1.jpg"})
    with pytest.raises(InputError, match=r"'a 1\.jpg'"):
        write_colmap_text(
            survey.model_copy(update={"photographs": (spaced, *survey.photographs[1:])}), tmp_path / "model"
        )


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("cameras.txt", "1 FOV 10 10 1 1 1 1 1\n", "lens model 'FOV'"),
        ("cameras.txt", "1 FULL_OPENCV 10 10 1 1 1 1 0 0 0 0 0 .1 0 0\n", "rational"),
        ("cameras.txt", "1 PINHOLE\n", "2 fields, not 5"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 gone.jpg\n\n", "gone.jpg"),
        ("points3D.txt", None, "incomplete"),
    ],
)
def test_models_that_cannot_be_read(survey: Survey, tmp_path: Path, name: str, text: str | None, what: str) -> None:
    folder = tmp_path / "model"
    write_colmap_text(survey, folder)
    (folder / name).unlink()
    if text is not None:
        (folder / name).write_text(text)
    with pytest.raises(InputError, match=what):
        read_colmap_text(folder, tmp_path / "photographs", survey.georeference)
