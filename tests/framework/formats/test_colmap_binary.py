from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.formats.colmap import read_colmap_model, write_colmap_text
from slideframe.formats.colmap_binary import read_colmap_binary, write_colmap_binary
from slideframe.formats.posed_model import PosedModel
from slideframe.products import Survey

ROUNDING = 1e-11  # of poses, which go through quaternions; all else is bit for bit


def assert_holds(model: PosedModel, survey: Survey) -> None:
    assert [view.name for view in model.views] == ["a.jpg", "b.jpg", "sub/a.jpg", "sub/c.jpg"]
    assert [view.camera for view in model.views] == [survey.camera_of(index) for index in range(4)]
    poses = [view.world_from_camera for view in model.views]
    np.testing.assert_allclose(poses, survey.world_from_camera, atol=ROUNDING)
    np.testing.assert_array_equal(model.points.astype(np.float32), survey.sparse_points)
    np.testing.assert_array_equal(model.colors, survey.sparse_colors)
    np.testing.assert_array_equal(model.errors.astype(np.float32), survey.sparse_errors)


def test_round_trip(survey: Survey, tmp_path: Path) -> None:
    write_colmap_binary(survey, tmp_path / "model")
    assert_holds(read_colmap_binary(tmp_path / "model"), survey)


def test_text_and_binary_hold_the_same(survey: Survey, tmp_path: Path) -> None:
    write_colmap_text(survey, tmp_path / "model")
    assert_holds(read_colmap_model(tmp_path / "model"), survey)


def test_colmap_reads_ours_and_we_read_colmaps(survey: Survey, tmp_path: Path) -> None:
    """COLMAP's own reader and writer in between; its writer adds rigs, frames, tracks and sightings."""
    pycolmap = pytest.importorskip("pycolmap")
    write_colmap_binary(survey, tmp_path / "model")
    theirs = pycolmap.Reconstruction(tmp_path / "model")
    assert theirs.num_reg_images() == 4
    image = theirs.image(3)
    np.testing.assert_allclose(image.cam_from_world().inverse().matrix(), survey.world_from_camera[2], atol=ROUNDING)
    image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([10.0, 20.0])) for _ in range(3)])
    theirs.add_observation(5, pycolmap.TrackElement(3, 1))
    (tmp_path / "again").mkdir()
    theirs.write_binary(tmp_path / "again")
    assert_holds(read_colmap_binary(tmp_path / "again"), survey)


def test_a_real_model(shared: Path) -> None:
    folder = shared / "data/uav/mirafiori_rtk/reference/prior_selfcal_enu"
    model = read_colmap_binary(folder)
    assert len(model.views) == 32
    assert len(model.points) == 16457
    assert model.views[0].camera.focal_x == pytest.approx(2044.4569993)
    pycolmap = pytest.importorskip("pycolmap")
    theirs = pycolmap.Reconstruction(folder)
    by_name = {image.name: image for image in theirs.images.values()}
    for view in model.views[::8]:
        np.testing.assert_allclose(
            by_name[view.name].cam_from_world().inverse().matrix(), view.world_from_camera, atol=1e-9
        )


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_file_that_breaks_off_is_named(survey: Survey, tmp_path: Path, name: str) -> None:
    write_colmap_binary(survey, tmp_path)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:-3])
    with pytest.raises(InputError, match="breaks off") as error:
        read_colmap_binary(tmp_path)
    assert name in str(error.value)
    (tmp_path / name).unlink()
    with pytest.raises(InputError, match="incomplete"):
        read_colmap_binary(tmp_path)


def test_a_lens_without_counterpart_is_refused(survey: Survey, tmp_path: Path) -> None:
    write_colmap_binary(survey, tmp_path)
    whole = bytearray((tmp_path / "cameras.bin").read_bytes())
    whole[12:16] = (5).to_bytes(4, "little")  # OPENCV_FISHEYE
    (tmp_path / "cameras.bin").write_bytes(whole)
    with pytest.raises(InputError, match="number 5"):
        read_colmap_binary(tmp_path)
