"""Another program's cameras, in the survey's frame: against the pictures' own known places."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.errors import InputError
from slideframe.formats.colmap import rotation_of, write_colmap_text, write_colmap_views
from slideframe.formats.posed_camera import PosedCamera
from slideframe.geodesy import ecef_from_geodetic, enu_axes, geodetic_from_enu
from slideframe.problem import Site
from slideframe.products import Camera, Georeference
from slideframe.stages import Context
from slideframe_pose_rtk.imported import between_frames, fit_similarity
from slideframe_pose_rtk.orientation import angle_between
from slideframe_pose_rtk.source import RtkPoses

ORIGIN = Georeference(latitude=45.0315, longitude=7.6206, ellipsoidal_height=349.5)
LENS = Camera(width=64, height=48, focal_x=60, focal_y=60, principal_x=31, principal_y=25)
DEGREE_ROUNDING = 1e-3  # m; metadata hold nine decimals of a degree and millimetres of height
TURN, SCALE, SHIFT = rotation_of(np.array([0.3, -0.5, 0.2, 0.7])), 0.21, np.array([4.0, -2.0, 9.0])


@pytest.fixture
def places() -> np.ndarray:
    generator = np.random.default_rng(6)
    return np.column_stack([generator.uniform(-30, 30, 9), generator.uniform(-30, 30, 9), generator.uniform(40, 60, 9)])


@pytest.fixture
def truth(places: np.ndarray) -> np.ndarray:
    generator = np.random.default_rng(7)
    return np.array([np.column_stack([rotation_of(generator.normal(size=4)), place]) for place in places])


@pytest.fixture
def folder(photograph: Callable[..., Path], drone_metadata, places: np.ndarray, tmp_path: Path) -> Path:
    """Photographs whose metadata tell the true places, but for one that is 40 m off."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    stated = places + np.eye(9)[:, [4]] * [40.0, 0.0, 0.0]
    for index, values in enumerate(geodetic_from_enu(stated, ORIGIN)):
        photograph(folder / f"{index}.jpg", drone_metadata(*values), shade=index)
    return folder


def locate(folder: Path, model: Path, context: Context):
    source = RtkPoses(model=model, origin=ORIGIN)
    site = Site(photographs=folder)
    source.preflight(site, context.device)
    assert model in {model, *source.input_files(site)} | {path.parent for path in source.input_files(site)}
    return source.locate(site, context)


def test_a_model_of_any_frame_is_brought_to_the_stated_positions(
    folder: Path, truth: np.ndarray, tmp_path: Path, context: Context
) -> None:
    """The similarity that made the model's frame is undone, and the false position pulls nothing."""
    strange = [np.column_stack([TURN @ pose[:, :3], SCALE * TURN @ pose[:, 3] + SHIFT]) for pose in truth]
    views = [PosedCamera(f"{index}.jpg", LENS, pose) for index, pose in enumerate(strange)]
    write_colmap_views(views, tmp_path / "model")
    survey = locate(folder, tmp_path / "model", context)
    np.testing.assert_allclose(survey.world_from_camera[:, :, 3], truth[:, :, 3], atol=DEGREE_ROUNDING)
    assert angle_between(survey.world_from_camera[:, :, :3], truth[:, :, :3]).max() < 0.01
    assert context.figures["model_reference"] == "similarity to the photographs' stated positions"
    assert context.figures["model_scale"] == pytest.approx(1 / SCALE, rel=1e-4)
    assert survey.cameras == (LENS,)
    assert survey.photographs[0].fix == "fixed"


def test_a_models_own_reference_is_kept_exactly(
    folder: Path, truth: np.ndarray, tmp_path: Path, context: Context
) -> None:
    """OpenSfM's frame about a place 800 m away, tilted by the Earth's curvature: no fit can hide an error."""
    elsewhere = Georeference(latitude=45.0385, longitude=7.6236, ellipsoidal_height=300.0)
    back = between_frames(ORIGIN, elsewhere)
    shots = {}
    for index, pose in enumerate(truth):
        moved = back.pose(pose)
        rotation = moved[:, :3].T
        angle = np.arccos((np.trace(rotation) - 1) / 2)
        axis = np.array(
            [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
        )
        shots[f"{index}.jpg"] = {
            "camera": "lens",
            "rotation": list(axis / (2 * np.sin(angle)) * angle),
            "translation": list(-rotation @ moved[:, 3]),
        }
    lens = {"projection_type": "perspective", "width": 64, "height": 48, "focal": 60 / 64, "k1": 0, "k2": 0}
    points = {"1": {"coordinates": list(back.points(np.zeros((1, 3)))[0]), "color": [1, 2, 3]}}
    model = [{"cameras": {"lens": lens}, "shots": shots, "points": points}]
    (tmp_path / "opensfm").mkdir()
    (tmp_path / "opensfm" / "reconstruction.json").write_text(json.dumps(model))
    place = {
        "latitude": elsewhere.latitude,
        "longitude": elsewhere.longitude,
        "altitude": elsewhere.ellipsoidal_height,
    }
    (tmp_path / "opensfm" / "reference_lla.json").write_text(json.dumps(place))
    survey = locate(folder, tmp_path / "opensfm", context)
    np.testing.assert_allclose(survey.world_from_camera, truth, atol=1e-7)
    np.testing.assert_allclose(survey.sparse_points, np.zeros((1, 3)), atol=1e-6)
    assert context.figures["model_reference"] == "the model's own"


def test_our_own_export_comes_back(folder: Path, truth: np.ndarray, tmp_path: Path, context: Context) -> None:
    write_colmap_views([PosedCamera(f"{i}.jpg", LENS, pose) for i, pose in enumerate(truth)], tmp_path / "model")
    survey = locate(folder, tmp_path / "model", context)
    write_colmap_text(survey, tmp_path / "again")
    again = locate(folder, tmp_path / "again", context)
    np.testing.assert_allclose(again.world_from_camera, survey.world_from_camera, atol=DEGREE_ROUNDING)


def without_metadata(folder: Path) -> None:
    """Strip the photographs of all that they tell, as programs that send pictures do."""
    for path in folder.iterdir():
        with Image.open(path) as picture:
            Image.fromarray(np.asarray(picture)).save(path, "JPEG")


def test_a_georeferenced_model_places_photographs_that_tell_nothing(
    folder: Path, truth: np.ndarray, tmp_path: Path, context: Context
) -> None:
    """Earth-centred poses as Metashape exports them; the pictures have no position, angles or focal length."""
    without_metadata(folder)
    origin = ecef_from_geodetic(np.array([[ORIGIN.latitude, ORIGIN.longitude, ORIGIN.ellipsoidal_height]]))[0]
    axes = enu_axes(ORIGIN)
    cameras = []
    for index, pose in enumerate(truth):
        matrix = np.eye(4)
        matrix[:3] = np.column_stack([axes.T @ pose[:, :3], axes.T @ pose[:, 3] + origin])
        numbers = " ".join(f"{value:.17g}" for value in matrix.ravel())
        cameras.append(f'<camera id="{index}" sensor_id="0" label="{index}"><transform>{numbers}</transform></camera>')
    (tmp_path / "cameras.xml").write_text(
        '<document><chunk><sensors><sensor id="0" label="lens" type="frame"><calibration class="adjusted">'
        '<resolution width="64" height="48"/><f>60</f><cx>-1</cx><cy>1</cy></calibration></sensor></sensors>'
        f"<cameras>{''.join(cameras)}</cameras></chunk></document>"
    )
    survey = locate(folder, tmp_path / "cameras.xml", context)
    np.testing.assert_allclose(survey.world_from_camera, truth, atol=1e-6)
    assert survey.cameras == (LENS,)
    assert {photograph.pose for photograph in survey.photographs} == {"imported"}
    assert {(photograph.stated_position, photograph.fix) for photograph in survey.photographs} == {(None, None)}
    assert context.figures["positions_from"] == {"model": 9.0}
    assert not [name for name in context.figures if name.startswith(("centre_residual", "gimbal"))]


def test_a_model_without_a_place_on_earth_needs_positions(
    folder: Path, truth: np.ndarray, tmp_path: Path, context: Context
) -> None:
    without_metadata(folder)
    write_colmap_views([PosedCamera(f"{i}.jpg", LENS, pose) for i, pose in enumerate(truth)], tmp_path / "model")
    with pytest.raises(InputError, match="there are 0") as error:
        locate(folder, tmp_path / "model", context)
    assert "imported model states no place on Earth either" in str(error.value)


def test_other_photographs_are_refused_by_name(folder: Path, truth: np.ndarray, tmp_path: Path, context) -> None:
    write_colmap_views([PosedCamera(f"x{i}.jpg", LENS, pose) for i, pose in enumerate(truth)], tmp_path / "model")
    with pytest.raises(InputError, match=r"x0\.jpg|only 0 of"):
        locate(folder, tmp_path / "model", context)
    larger = LENS.model_copy(update={"width": 128, "height": 96})
    write_colmap_views([PosedCamera(f"{i}.jpg", larger, pose) for i, pose in enumerate(truth)], tmp_path / "large")
    with pytest.raises(InputError, match="128x96 in"):
        locate(folder, tmp_path / "large", context)


def test_cameras_on_one_line_leave_a_turn_open() -> None:
    line = np.linspace(0, 1, 8)[:, None] * [10.0, 5.0, 0.0]
    with pytest.raises(InputError, match="one line"):
        fit_similarity(line, line, np.ones(8), "here")


def test_a_real_result(shared: Path, context: Context) -> None:
    """Mirafiori's reference solution, made with pycolmap in the frame of the flight's mean position."""
    flight = shared / "data/uav/mirafiori_rtk"
    source = RtkPoses(model=flight / "reference/prior_selfcal_enu")
    survey = source.locate(Site(photographs=flight / "images"), context)
    assert len(survey.photographs) == 32
    assert len(survey.sparse_points) == 16457
    assert context.figures["model_scale"] == pytest.approx(1.0, abs=1e-3)
    assert context.figures["reprojection_error_px"] == pytest.approx(0.52, abs=0.01)
    for axis in ("east", "north", "up"):
        assert context.figures[f"centre_residual_{axis}_m"] < 0.015
    assert context.figures["gimbal_error_deg"] == pytest.approx(0.82, abs=0.02)
    assert not survey.left_out
