"""Against OpenSfM's documented projection, written out here a second time."""

import json
from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.formats.models import posed_model_files, read_posed_model
from slideframe.formats.opensfm import read_opensfm
from slideframe.photographs import distort

WIDTH, HEIGHT = 1600, 1300
BROWN = {
    "projection_type": "brown", "width": WIDTH, "height": HEIGHT, "focal_x": 1.23, "focal_y": 1.22,
    "c_x": 0.011, "c_y": -0.004, "k1": -0.1, "k2": 0.02, "k3": 0.003, "p1": 1e-3, "p2": -2e-3,
}  # fmt: skip
PERSPECTIVE = {
    "projection_type": "perspective",
    "width": WIDTH,
    "height": HEIGHT,
    "focal": 0.9,
    "k1": -0.05,
    "k2": 0.01,
}
SHOT = {"camera": "lens", "rotation": [1.9, 0.4, -0.3], "translation": [3.0, -2.0, 40.0]}


def write(folder: Path, lens: dict, reference: bool = True) -> Path:
    model = {
        "cameras": {"lens": lens},
        "shots": {"b.jpg": SHOT, "a.jpg": {**SHOT, "rotation": [0.0, 0.0, 0.0]}},
        "points": {"10": {"coordinates": [1, 2, 3], "color": [10, 20, 30]}, "9": {"coordinates": [4, 5, 6]}},
    }
    smaller = {"cameras": {"lens": lens}, "shots": {"c.jpg": SHOT}, "points": {}}
    (folder / "reconstruction.json").write_text(json.dumps([smaller, model]))
    if reference:
        place = {"latitude": 45.03, "longitude": 7.62, "altitude": 349.5}
        (folder / "reference_lla.json").write_text(json.dumps(place))
    return folder / "reconstruction.json"


def project_as_opensfm(point: np.ndarray, lens: dict) -> np.ndarray:
    """Turn about the axis by scipy, divide, distort, scale by the longer side, shift to the corner."""
    from scipy.spatial.transform import Rotation

    x, y, z = Rotation.from_rotvec(SHOT["rotation"]).apply(point) + SHOT["translation"]
    x, y = x / z, y / z
    square = x * x + y * y
    k1, k2, k3, p1, p2 = (lens.get(name, 0.0) for name in ("k1", "k2", "k3", "p1", "p2"))
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    down = y * radial + 2 * p2 * x * y + p1 * (square + 2 * y * y)
    size = max(WIDTH, HEIGHT)
    column = size * (lens.get("focal_x", lens.get("focal")) * across + lens.get("c_x", 0.0)) + WIDTH / 2
    row = size * (lens.get("focal_y", lens.get("focal")) * down + lens.get("c_y", 0.0)) + HEIGHT / 2
    return np.array([column, row])


@pytest.mark.parametrize("lens", [BROWN, PERSPECTIVE], ids=["brown", "perspective"])
def test_a_point_falls_where_opensfm_puts_it(tmp_path: Path, lens: dict) -> None:
    model = read_opensfm(write(tmp_path, lens))
    view = model.views[1]
    assert view.name == "b.jpg"
    point = np.array([2.0, 3.0, -1.0])
    x, y, z = (point - view.world_from_camera[:, 3]) @ view.world_from_camera[:, :3]
    slopes = distort(np.array([x / z, y / z]), view.camera.distortion)
    camera = view.camera
    pixel = slopes * [camera.focal_x, camera.focal_y] + [camera.principal_x, camera.principal_y]
    np.testing.assert_allclose(pixel, project_as_opensfm(point, lens), atol=1e-9)


def test_points_come_in_the_order_of_their_numbers_and_smaller_parts_are_told(tmp_path: Path) -> None:
    model = read_opensfm(write(tmp_path, BROWN))
    np.testing.assert_array_equal(model.points, [[4, 5, 6], [1, 2, 3]])
    np.testing.assert_array_equal(model.colors[1], [10, 20, 30])
    assert np.isnan(model.errors).all(), "the file keeps none"
    assert "1 shots" in model.remarks[0]
    assert model.georeference is not None
    assert model.georeference.ellipsoidal_height == 349.5


def test_without_a_reference_there_is_none(tmp_path: Path) -> None:
    assert read_opensfm(write(tmp_path, BROWN, reference=False)).georeference is None


def test_odms_topocentric_model_is_read_in_place_of_the_projected_one(tmp_path: Path) -> None:
    """ODM leaves its projected frame under OpenSfM's name: here turned by 1.5 degrees and moved, as a grid's is."""
    from scipy.spatial.transform import Rotation

    truth = write(tmp_path, BROWN).read_text()
    (tmp_path / "reconstruction.topocentric.json").write_text(truth)
    grid = json.loads(truth)
    for shot in grid[1]["shots"].values():
        turned = Rotation.from_rotvec(shot["rotation"]) * Rotation.from_euler("z", 1.5, degrees=True)
        shot["rotation"] = turned.as_rotvec().tolist()
    (tmp_path / "reconstruction.json").write_text(json.dumps(grid))
    model = read_posed_model(tmp_path)
    alone = read_opensfm(tmp_path / "reconstruction.topocentric.json")
    for view, expected in zip(model.views, alone.views, strict=True):
        np.testing.assert_array_equal(view.world_from_camera, expected.world_from_camera)
    rotation = model.views[1].world_from_camera[:, :3].T
    np.testing.assert_allclose(rotation, Rotation.from_rotvec(SHOT["rotation"]).as_matrix(), atol=1e-12)
    assert tmp_path / "reconstruction.topocentric.json" in posed_model_files(tmp_path)


def test_a_lens_without_counterpart_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fisheye"):
        read_opensfm(write(tmp_path, {**PERSPECTIVE, "projection_type": "fisheye"}))


@pytest.mark.parametrize("text", ["{}", "[]", "[{}]", "no json", "[1]"])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "reconstruction.json").write_text(text)
    with pytest.raises(InputError, match=r"reconstruction\.json"):
        read_opensfm(tmp_path / "reconstruction.json")
