from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.errors import InputError
from slideframe.formats.colmap import quaternion_of, read_colmap_text, rotation_of, write_colmap_text
from slideframe.products import Camera, Georeference, Photograph, Survey

ROUNDING = 1e-12
GEOREFERENCE = Georeference(latitude=22.28, longitude=114.2, ellipsoidal_height=148.4)
COUNT = 4


@pytest.fixture
def survey(tmp_path: Path) -> Survey:
    """Photographs in two folders, of three cameras, looking anywhere."""
    generator = np.random.default_rng(3)
    paths = [tmp_path / "photographs" / name for name in ("a.jpg", "b.jpg", "sub/a.jpg", "sub/c.jpg")]
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_bytes(bytes([number]))
    rotations = [rotation_of(generator.normal(size=4)) for _ in paths]
    size = {
        "width": 1600,
        "height": 1300,
        "focal_x": 1973.09,
        "focal_y": 1955.65,
        "principal_x": 781,
        "principal_y": 638.6,
    }
    distortions = [(0.0,) * 5, (-0.1, 0.02, 1e-3, 2e-3, 0.0), (-0.42275, 0.369101, 0.0040638, 0.0040638, -0.264306)]
    digests = [
        "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
        "4bf5122f344554c53bde2ebb8cd2b7e3d1600ad631c385a5d7cce23c7785459a",
        "dbc1b4c900ffe48d575b5da5c638040125f65db0fe3e24494b76ea986457d986",
        "084fed08b978af4d7d196a7446a86b58009e636b611db16211b65a9aadff29c5",
    ]
    return Survey(
        georeference=GEOREFERENCE,
        cameras=tuple(Camera(**size, distortion=distortion) for distortion in distortions),
        photographs=tuple(
            Photograph(path=path, camera=number % 3, sha256=digest)
            for number, (path, digest) in enumerate(zip(paths, digests, strict=True))
        ),
        world_from_camera=np.stack([np.column_stack([r, generator.normal(size=3) * 50]) for r in rotations]),
        position_sigma=np.zeros((COUNT, 3)),
        sparse_points=generator.normal(size=(20, 3)).astype(np.float32),
        sparse_colors=generator.integers(0, 256, (20, 3)).astype(np.uint8),
        sparse_errors=generator.random(20).astype(np.float32),
    )


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_quaternions_and_rotations_are_the_same(values: list[float]) -> None:
    unit = np.array(values) / np.linalg.norm(values)
    back = quaternion_of(rotation_of(unit))
    assert abs(back @ unit) == pytest.approx(1.0, abs=ROUNDING)
    np.testing.assert_allclose(rotation_of(back), rotation_of(unit), atol=ROUNDING)


def test_round_trip(survey: Survey, tmp_path: Path) -> None:
    write_colmap_text(survey, tmp_path / "model")
    back = read_colmap_text(tmp_path / "model", tmp_path / "photographs", GEOREFERENCE)
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
        read_colmap_text(folder, tmp_path / "photographs", GEOREFERENCE)
