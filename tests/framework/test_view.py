"""Where the camera goes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from slideframe.errors import ConfigurationError, InputError
from slideframe.formats.colmap import write_colmap_views
from slideframe.formats.posed_camera import PosedCamera, posed_cameras
from slideframe.formats.transforms_json import write_transforms_json
from slideframe.pipeline import require_view_of_survey
from slideframe.problem import FileView, FlightView, OrbitView, SurveyView, View
from slideframe.products import Camera, Survey
from slideframe.rotations import quaternions_of, rotation_matrices
from slideframe.testing.ground_scenes import hillside_survey

BOUNDS = np.float32([[-5, -5, 0], [5, 5, 8]])


def survey() -> Survey:
    """The hillside's four cameras, under four names, two of them tilted."""
    plain = hillside_survey()
    photographs = tuple(
        photograph.model_copy(update={"path": photograph.path.with_name(f"DJI_{index}.jpg")})
        for index, photograph in enumerate(plain.photographs)
    )
    poses = plain.world_from_camera.copy()
    tilt = rotation_matrices(np.array([[0.97, 0.2, 0.1, 0.0]]))[0]
    poses[1:3, :, :3] = tilt @ poses[1:3, :, :3]
    return plain.model_copy(update={"photographs": photographs, "world_from_camera": poses})


def test_the_kind_chooses_the_view_and_an_old_config_is_an_orbit():
    read = TypeAdapter(View).validate_python
    assert read({"azimuth": 205.0, "turn": 20.0}) == OrbitView(azimuth=205, turn=20)
    assert isinstance(read({"kind": "survey", "photographs": ["a.jpg"]}), SurveyView)
    with pytest.raises(ValidationError, match="azimuth"):
        read({"kind": "flight", "positions": [[0, 0, 9]], "targets": [[0, 0, 0]], "azimuth": 3})
    with pytest.raises(ValidationError, match="zoom"):
        read({"kind": "zoom"})


@pytest.mark.parametrize("field", [{"width": 0}, {"height": 0}, {"width": 33}, {"supersampling": 0}])
def test_a_picture_without_size_is_refused(field):
    with pytest.raises(ValidationError, match=next(iter(field))):
        OrbitView(**field)


def test_a_survey_s_view_is_the_photograph_s_camera():
    camera, pose = SurveyView(photographs=("DJI_1",), width=640, height=360).shot(survey(), BOUNDS)(0.4)
    np.testing.assert_allclose(pose, survey().world_from_camera[1], atol=1e-12)
    lens = survey().cameras[0]
    # a point at the photograph's left edge, at the height of its principal point, is at the film's left edge
    assert camera.focal_x / camera.principal_x == pytest.approx(lens.focal_x / lens.principal_x)
    assert (camera.width, camera.height) == (640, 360)
    assert camera.principal_y == pytest.approx(180)
    wide = SurveyView(photographs=("DJI_1",), field_of_view=90, width=640, height=360).shot(survey(), BOUNDS)(0)[0]
    assert wide.focal_x == pytest.approx(320)
    with pytest.raises(InputError, match=r"no view named 'DJI_9'(.|\n)*DJI_"):
        SurveyView(photographs=("DJI_9",)).shot(survey(), BOUNDS)


def test_a_flight_through_photographs_meets_each_of_them():
    names = ("DJI_3", "DJI_0", "DJI_1")
    shot = SurveyView(photographs=names).shot(survey(), BOUNDS)
    for share, index in ((0, 3), (0.5, 0), (1, 1)):
        np.testing.assert_allclose(shot(share)[1], survey().world_from_camera[index], atol=1e-9)
    # and turns smoothly between them
    turns = np.array([shot(share)[1][:, :3] for share in np.linspace(0, 1, 201)])
    quaternions = quaternions_of(turns)
    steps = 1 - np.abs(np.sum(quaternions[1:] * quaternions[:-1], axis=1))
    assert steps.max() < 1e-3
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape), atol=1e-9)


@given(st.lists(st.floats(0.05, 1), min_size=1, max_size=5), st.integers(0, 2**31))
def test_a_flight_passes_its_key_frames_looking_at_its_targets(steps, seed):
    random = np.random.default_rng(seed)
    shares = np.cumsum([0, *steps])
    shares = tuple(map(float, shares / shares[-1]))
    positions = random.uniform([20, -40, 60], [40, 40, 140], (len(shares), 3))
    targets = random.uniform(-5, 5, (len(shares), 3))
    view = FlightView(positions=positions.tolist(), targets=targets.tolist(), shares=shares)
    shot = view.shot(survey(), BOUNDS)
    for share, position, target in zip(shares, positions, targets, strict=True):
        _, pose = shot(share)
        np.testing.assert_allclose(pose[:, 3], position, atol=1e-9)
        forward = (target - position) / np.linalg.norm(target - position)
        np.testing.assert_allclose(pose[:, 2], forward, atol=1e-9)
        assert pose[2, 0] == pytest.approx(0, abs=1e-9)  # held level
        assert pose[2, 1] < 0  # the picture's down is down
        assert np.linalg.det(pose[:, :3]) == pytest.approx(1)


def test_a_flight_never_jumps_in_speed():
    """Distances of equal steps change by little from one to the next, through the key frames too."""
    view = FlightView(positions=((0, -50, 40), (30, -30, 30), (40, 10, 60)), targets=((0, 0, 0),), shares=(0, 0.3, 1))
    shot = view.shot(survey(), BOUNDS)
    places = np.array([shot(share)[1][:, 3] for share in np.linspace(0, 1, 1001)])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert np.abs(np.diff(speeds)).max() < 0.02 * speeds.max()


def test_a_camera_may_look_straight_down():
    _, pose = FlightView(positions=((0, 0, 50),), targets=((0, 0, 0),)).shot(survey(), BOUNDS)(0)
    np.testing.assert_allclose(pose[:, :3], np.diag([1, -1, -1]), atol=1e-12)  # north above


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"targets": ((0, 0, 0), (0, 0, 1))}, "3 positions but 2 targets"),
        ({"shares": (0, 1)}, "3 positions but 2 shares"),
        ({"shares": (0, 0.5, 0.5)}, "rise"),
        ({"targets": ((0, 0, 9),)}, "its own target"),
    ],
)
def test_key_frames_that_don_t_fit_are_refused(wrong, complaint):
    fine = {"positions": ((0, 0, 9), (1, 0, 9), (2, 0, 9)), "targets": ((0, 0, 0),)}
    with pytest.raises(ValidationError, match=complaint):
        FlightView(**(fine | wrong))


@pytest.mark.parametrize("form", ["transforms.json", "model"])
def test_views_come_from_other_programs_files(tmp_path, form):
    views = posed_cameras(survey())
    if form == "model":
        write_colmap_views(views, tmp_path / form)
    else:
        write_transforms_json(views, tmp_path / form)
    view = FileView(path=tmp_path / form)
    shot = view.shot(survey(), BOUNDS)
    for index in range(4):
        np.testing.assert_allclose(shot(index / 3)[1], survey().world_from_camera[index], atol=1e-9)
    one = FileView(path=tmp_path / form, views=("DJI_2.jpg",)).shot(survey(), BOUNDS)
    np.testing.assert_allclose(one(0.7)[1], survey().world_from_camera[2], atol=1e-9)
    view.require_files()
    with pytest.raises(InputError, match=r"none"):
        FileView(path=tmp_path / "none").require_files()


def test_a_camera_that_leaves_the_survey_is_refused_before_hours_are_spent():
    require_view_of_survey(survey(), SurveyView(photographs=("DJI_0", "DJI_3")))
    require_view_of_survey(survey(), OrbitView())
    away = FlightView(positions=((0, 0, 50), (0, 0, 50)), targets=((0, 0, 0), (0, 400, 50)))
    with pytest.raises(ConfigurationError, match=r"sees nothing of the survey when \d+%(.|\n)*x -1\d\.\d to 1\d\.\d"):
        require_view_of_survey(survey(), away)


def test_lenses_of_other_sizes_meet_in_one_picture(tmp_path):
    pose = survey().world_from_camera[0]
    small = Camera(width=100, height=80, focal_x=80, focal_y=80, principal_x=50, principal_y=40)
    large = Camera(width=400, height=200, focal_x=400, focal_y=400, principal_x=210, principal_y=100)
    write_transforms_json([PosedCamera("a", small, pose), PosedCamera("b", large, pose)], tmp_path / "t.json")
    shot = FileView(path=tmp_path / "t.json", width=200, height=100).shot(survey(), BOUNDS)
    assert [shot(share)[0].focal_x for share in (0, 1)] == pytest.approx([160, 200])
    assert shot(1)[0].principal_x == pytest.approx(105)
