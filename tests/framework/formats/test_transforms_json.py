"""Cameras to and from transforms.json."""

import json
import math

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.formats.colmap import read_colmap_views, rotation_of, write_colmap_views
from slideframe.formats.posed_camera import PosedCamera, choose_views
from slideframe.formats.transforms_json import read_transforms_json, write_transforms_json
from slideframe.products import Camera

# numbers go through decimal text of full length
ROUNDING = 1e-12


def views() -> list[PosedCamera]:
    random = np.random.default_rng(1)
    lenses = [
        Camera(width=640, height=480, focal_x=500.5, focal_y=501.5, principal_x=319.0, principal_y=242.0),
        Camera(
            width=800, height=600, focal_x=700, focal_y=700, principal_x=400, principal_y=300,
            distortion=(-0.1, 0.02, 1e-3, 2e-3, 0.0),
        ),
    ]  # fmt: skip
    poses = [np.column_stack([rotation_of(random.normal(size=4)), random.normal(size=3) * 40]) for _ in range(4)]
    names = ["a/one.jpg", "a/two.jpg", "b/one.jpg", "b/three.png"]
    return [PosedCamera(name, lenses[i % 2], pose) for i, (name, pose) in enumerate(zip(names, poses, strict=True))]


def assert_alike(mine: list[PosedCamera], theirs: list[PosedCamera]) -> None:
    assert [view.name for view in mine] == [view.name for view in theirs]
    assert [view.camera for view in mine] == [view.camera for view in theirs]
    for one, other in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(one.world_from_camera, other.world_from_camera, atol=40 * ROUNDING)


def test_views_come_back(tmp_path):
    write_transforms_json(views(), tmp_path / "transforms.json")
    assert_alike(read_transforms_json(tmp_path / "transforms.json"), views())
    write_colmap_views(views(), tmp_path / "model")
    assert_alike(read_colmap_views(tmp_path / "model"), views())


def test_a_camera_looks_along_minus_z_there(tmp_path):
    """A camera at (1, 2, 3) that looks north with its upper side up."""
    pose = np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0], [1, 2, 3]])
    write_transforms_json([PosedCamera("x.png", views()[0].camera, pose)], tmp_path / "t.json")
    matrix = np.array(json.loads((tmp_path / "t.json").read_text())["frames"][0]["transform_matrix"])
    np.testing.assert_allclose(matrix @ [0, 0, -5, 1], [1, 7, 3, 1])
    np.testing.assert_allclose(matrix @ [0, 1, 0, 1], [1, 2, 4, 1])


def test_nerfstudio_s_turned_world_and_common_lens_are_read(tmp_path):
    """ns-process-data swaps the world's axes and tells so; instant-ngp gives a field of view."""
    pose = np.eye(4)
    pose[:3, 3] = [1, 2, 3]
    applied = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]])
    turned = np.vstack([applied, [0, 0, 0, 1]]) @ pose
    content = {
        "w": 200, "h": 100, "camera_angle_x": math.pi / 2, "applied_transform": applied.tolist(),
        "frames": [{"file_path": "./images/1.jpg", "transform_matrix": turned.tolist()}],
    }  # fmt: skip
    (tmp_path / "t.json").write_text(json.dumps(content))
    (view,) = read_transforms_json(tmp_path / "t.json")
    assert view.name == "images/1.jpg"
    assert view.camera.focal_y == view.camera.focal_x == pytest.approx(100)
    np.testing.assert_allclose(view.world_from_camera[:, 3], [1, 2, 3])
    np.testing.assert_allclose(view.world_from_camera[:, :3], np.diag([1, -1, -1]), atol=ROUNDING)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "no transforms.json"),
        ("{}", "'frames'"),
        ('{"frames": [{"w": 1}]}', "frame 0 .* lacks 'transform_matrix'"),
        ('{"w": 4, "h": 4, "fl_x": 2, "frames": [{"transform_matrix": [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}',
         "no rotation"),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_refused(tmp_path, text, complaint):
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_transforms_json(tmp_path / "t.json")


def test_views_are_chosen_by_name(tmp_path):
    assert [view.name for view in choose_views(views(), ["three.png", "a/one"], "x")] == ["b/three.png", "a/one.jpg"]
    with pytest.raises(InputError, match=r"2 views named 'one\.jpg'"):
        choose_views(views(), ["one.jpg"], "x")
    with pytest.raises(InputError, match=r"b/three\.png"):
        choose_views(views(), ["thee.png"], "x")
