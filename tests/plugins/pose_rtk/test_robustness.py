"""Surveys with faults in their metadata: stated, and handled or refused."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from slideframe.device import Device
from slideframe.errors import InputError
from slideframe.geodesy import geodetic_from_enu
from slideframe.problem import Site
from slideframe.products import Georeference, Survey
from slideframe.quality.appraisal import appraise
from slideframe.quality.pictures import PictureQuality
from slideframe.stages import Context
from slideframe_pose_rtk import correspondences
from slideframe_pose_rtk.features import Features, PictureFile
from slideframe_pose_rtk.orientation import angle_between, world_from_camera
from slideframe_pose_rtk.pairs import Pair
from slideframe_pose_rtk.source import RtkPoses

ORIGIN = Georeference(latitude=45.03, longitude=7.62, ellipsoidal_height=350.0)
SIZE = (800, 600)
FOCAL = 24 * np.hypot(*SIZE) / np.hypot(36, 24)  # what EXIF's 24 mm means
HEIGHT = 45.0
START = datetime(2026, 1, 26, 9, 0, tzinfo=UTC)
RTK_SIGMA = (0.010, 0.011, 0.020)  # as the metadata state it
GIMBAL_NOISE, YAW_BIAS = 0.3, 1.6  # degrees
PIXEL_NOISE = 0.4


@dataclass
class KnownSurvey:
    """Strips of photographs over hilly ground, looking down and 30 degrees off in turn.

    What metadata state can be made to differ from the truth photograph by photograph before `write`.
    """

    count: int = 20
    point_count: int = 900
    seed: int = 1
    values: dict[int, dict[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.random = random = np.random.default_rng(self.seed)
        x, y = random.uniform(-60, 60, self.point_count), random.uniform(-45, 45, self.point_count)
        self.points = np.column_stack([x, y, 4 * np.sin(x / 9) + 3 * np.cos(y / 7) + 0.1 * y])
        strip = np.arange(self.count) // 5
        along = np.arange(self.count) % 5
        self.positions = np.column_stack(
            [(along - 2) * 18.0, (strip - strip.max() / 2) * 16.0, HEIGHT + random.normal(0, 0.5, self.count)]
        )
        self.angles = np.column_stack(
            [
                np.where(strip % 2, 270.0, 90.0) + random.normal(0, 3, self.count),
                np.where(along % 2, -60.0, -90.0),
                np.zeros(self.count),
            ]
        )
        self.truth = np.array(
            [
                np.column_stack([world_from_camera(*angles), place])
                for angles, place in zip(self.angles, self.positions, strict=True)
            ]
        )
        self.stated_positions = self.positions + random.normal(0, RTK_SIGMA, (self.count, 3))
        self.stated_angles = self.angles + random.normal(0, GIMBAL_NOISE, (self.count, 3)) + [YAW_BIAS, 0, 0]
        self.times = [START + timedelta(seconds=4 * index) for index in range(self.count)]
        self.sightings = [self._sighted(pose) for pose in self.truth]

    def _sighted(self, pose: np.ndarray) -> dict[int, np.ndarray]:
        x, y, depth = ((self.points - pose[:, 3]) @ pose[:, :3]).T
        pixels = np.column_stack([x, y]) / depth[:, None] * FOCAL + np.array(SIZE) / 2
        inside = (depth > 0) & ((pixels > 0) & (pixels < SIZE)).all(axis=1)
        noisy = pixels + self.random.normal(0, PIXEL_NOISE, pixels.shape)
        return {int(number): noisy[number] for number in np.flatnonzero(inside)}

    def write(self, folder: Path, photograph: Callable[..., Path], drone_metadata: Callable[..., dict]) -> Path:
        """Write a small file for each photograph, with the metadata as they are to be."""
        folder.mkdir()
        geodetic = geodetic_from_enu(self.stated_positions, ORIGIN)
        for index, (latitude, longitude, height) in enumerate(geodetic):
            yaw, pitch, roll = self.stated_angles[index]
            values = drone_metadata(latitude, longitude, height, (yaw + 180) % 360 - 180, pitch)
            sigma = dict(zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), map(str, RTK_SIGMA), strict=True))
            values |= {"GimbalRollDegree": f"{roll:+.2f}", "RelativeAltitude": f"{HEIGHT:+.1f}", **sigma}
            values["UTCAtExposure"] = self.times[index].strftime("%Y-%m-%dT%H:%M:%S.%f")
            photograph(folder / f"{index:02d}.jpg", values | self.values.get(index, {}), size=SIZE, shade=index)
        return folder

    def locate(
        self, folder: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch, **options: object
    ) -> tuple[Survey, Context]:
        """Run the whole stage, but for the looking at pictures."""
        monkeypatch.setattr(correspondences, "find_features", self._features)
        monkeypatch.setattr(correspondences, "match_photographs", self._matches)
        scratch.mkdir()
        context = Context(device=Device(), scratch=scratch)
        source = RtkPoses(origin=ORIGIN, **options)
        site = Site(photographs=folder)
        source.preflight(site, context.device)
        return source.locate(site, context), context

    def centre_error(self, survey: Survey) -> np.ndarray:
        """Return rms per axis, m."""
        offset = survey.world_from_camera[:, :, 3] - self._true_poses(survey)[:, :, 3]
        return np.sqrt(np.mean(offset**2, axis=0))

    def angle_error(self, survey: Survey) -> np.ndarray:
        """Return degrees by photograph."""
        return angle_between(survey.world_from_camera[:, :, :3], self._true_poses(survey)[:, :, :3])

    def _true_poses(self, survey: Survey) -> np.ndarray:
        return self.truth[[int(photograph.path.stem) for photograph in survey.photographs]]

    def _features(self, pictures: Sequence[PictureFile], *_: object) -> list[Features]:
        found = []
        for path in (picture.path for picture in pictures):
            pixels = np.array(list(self.sightings[int(path.stem)].values()))
            keypoints = np.column_stack([pixels, np.ones(len(pixels)), np.zeros(len(pixels))]).astype(np.float32)
            quality = PictureQuality(sharpness=0.8, contrast=40.0)
            found.append(Features(path.stem, keypoints, np.zeros((len(pixels), 128), np.uint8), quality))
        return found

    def _matches(self, features: Sequence[Features], _: object, pairs: Sequence[Pair], *__: object) -> dict:
        rows = [
            {point: row for row, point in enumerate(self.sightings[int(one.key)])} for one in features
        ]  # by photograph: the row of each point
        matches = {}
        for first, second in pairs:
            common = sorted(rows[first].keys() & rows[second].keys())
            if len(common) >= 15:
                matches[first, second] = np.array(
                    [(rows[first][point], rows[second][point]) for point in common], np.uint32
                )
        return matches


CENTRE, ANGLE = 0.03, 0.1  # m rms per axis, degrees


@pytest.fixture
def run(tmp_path: Path, photograph, drone_metadata, monkeypatch: pytest.MonkeyPatch):
    def located(known: KnownSurvey, **options: object):
        folder = known.write(tmp_path / "photographs", photograph, drone_metadata)
        return known.locate(folder, tmp_path / "scratch", monkeypatch, **options)

    return located


def test_a_sound_survey_comes_out_true_and_without_complaint(run) -> None:
    known = KnownSurvey()
    survey, context = run(known)
    assert known.centre_error(survey).max() < CENTRE
    assert np.median(known.angle_error(survey)) < ANGLE
    assert context.figures["flights"] == 1
    assert context.figures["gimbal_yaw_bias_deg"]["flight 1"] == pytest.approx(1.6, abs=0.3)
    assert context.figures["focal_length_rule"].startswith("free: 40% of the views are oblique")
    assert not [warning for warning in context.warnings if "35 mm" not in warning]


def test_a_flight_with_opposite_headings_is_turned(run) -> None:
    """The second of two flights, ten minutes later, has its compass 180 degrees off."""
    known = KnownSurvey()
    late = np.arange(known.count) >= known.count // 2
    known.times = [time + timedelta(minutes=10) * bool(second) for time, second in zip(known.times, late, strict=True)]
    known.stated_angles[late, 0] += 180.0
    survey, context = run(known)
    assert known.centre_error(survey).max() < CENTRE
    assert np.median(known.angle_error(survey)) < ANGLE
    assert len(survey.photographs) == known.count
    assert context.figures["flights"] == 2
    (warning,) = (text for text in context.warnings if "35 mm" not in text)
    assert "flight 2 (10 photographs)" in warning
    assert "headings" in warning
    assert abs(abs(context.figures["gimbal_yaw_bias_deg"]["flight 2"]) - 180) < 3


def test_metadatas_poses_alone_are_kept_and_the_fault_is_stated(run) -> None:
    known = KnownSurvey()
    known.stated_angles[:, 0] += 180.0
    survey, context = run(known, refine=False)
    assert "useless" in next(text for text in context.warnings if "headings" in text)
    assert np.median(known.angle_error(survey)) > 90


def test_what_cant_be_registered_is_left_out_by_default(run) -> None:
    known = KnownSurvey()
    unmatched(known, 7)
    survey, context = run(known)
    assert [item.name for item in survey.left_out] == ["07.jpg"]
    assert "1 of 20 photographs couldn't be registered and are left out: 07.jpg" in "\n".join(context.warnings)
    assert {photograph.pose for photograph in survey.photographs} == {"adjusted"}


def test_false_positions_are_found_and_not_used(run) -> None:
    known = KnownSurvey()
    known.stated_positions[3] += [6.0, -4.0, 0.0]
    known.stated_positions[12] += [0.0, 0.0, 1.5]
    survey, context = run(known)
    assert len(survey.photographs) == known.count
    assert known.centre_error(survey).max() < CENTRE
    warning = next(text for text in context.warnings if "contradict" in text)
    assert "2 photographs" in warning
    assert "03.jpg, 12.jpg" in warning
    appraisal = appraise(survey)
    assert appraisal.outliers.tolist() == [3, 12]
    assert appraisal.figures["position_residual_east_m"] < CENTRE


def test_noise_ten_times_as_large_as_stated_is_stated(run) -> None:
    known = KnownSurvey()
    known.stated_positions = known.positions + known.random.normal(0, 10 * np.array(RTK_SIGMA), (known.count, 3))
    survey, context = run(known)
    warning = next(text for text in context.warnings if "scatter" in text)
    assert "times as much as their sigmas say" in warning
    assert known.centre_error(survey).max() < 10 * max(RTK_SIGMA), "better than the positions themselves"
    assert survey.position_sigma[0, 0] > 5 * RTK_SIGMA[0]
    assert not any("contradict" in text for text in context.warnings)


def test_float_solutions_weigh_as_little_as_they_are_worth(run) -> None:
    """Half of the positions are float, half a metre off; the fixed ones hold the survey."""
    known = KnownSurvey()
    for index in range(0, known.count, 2):
        known.stated_positions[index] = known.positions[index] + known.random.normal(0, 0.5, 3)
        known.values[index] = {"RtkFlag": "34", "RtkStdLon": "0.5", "RtkStdLat": "0.5", "RtkStdHgt": "0.8"}
    survey, context = run(known)
    assert known.centre_error(survey).max() < 0.05
    assert "10 of 20 photographs have no fixed RTK position" in "\n".join(context.warnings)
    assert "RTK fixed on 50%" in str(appraise(survey).verdict)


def test_two_cameras_of_one_survey_keep_lenses_of_their_own(run) -> None:
    known = KnownSurvey()
    for index in range(0, known.count, 2):
        known.values[index] = {"Model": "other"}
    survey, _ = run(known)
    assert known.centre_error(survey).max() < CENTRE


@pytest.fixture
def surveyed(tmp_path: Path):
    """Write eight points of a survey as its photographs show them, five control and three check."""

    def write(known: KnownSurvey, raised: float = 0.0) -> Path:
        chosen = [int(n) for n in np.argsort(np.abs(known.points[:, :2] / [35, 25]).max(axis=1))[::25][:8]]
        geodetic = geodetic_from_enu(known.points, ORIGIN) + np.array([0.0, 0.0, raised])
        lines = ["name,role,latitude,longitude,ellipsoidal_height,photograph,column,row"]
        for place, number in enumerate(chosen):
            latitude, longitude, height = geodetic[number]
            point = f"P{place},{'control' if place < 5 else 'check'},{latitude:.10f},{longitude:.10f},{height:.4f}"
            for index, seen in enumerate(known.sightings):
                if number in seen:
                    lines.append(f"{point},{index:02d}.jpg,{seen[number][0]},{seen[number][1]}")
        path = tmp_path / "points.csv"
        path.write_text("\n".join(lines))
        return path

    return write


def test_surveyed_points_free_the_focal_length_and_check_it(run, surveyed) -> None:
    """Straight down from one height, with a focal length 1.5 % off, which only the control points tell."""
    known = KnownSurvey()
    known.angles[:, 1] = -90.0
    known.truth[:, :, :3] = [world_from_camera(*angles) for angles in known.angles]
    known.stated_angles[:, 1] = -90.0
    known.sightings = [known._sighted(pose) for pose in known.truth]
    centre = np.array([400.0, 300.0])
    for seen in known.sightings:
        for number in seen:
            seen[number] = centre + 1.015 * (seen[number] - centre)
    survey, context = run(known, control=surveyed(known))
    assert context.figures["focal_length_rule"] == "free: 5 control points determine it"
    roles = [point.role for point in survey.ground_points]
    assert roles == ["control"] * 5 + ["check"] * 3
    figures = appraise(survey).figures
    for axis in ("east", "north", "up"):
        assert figures[f"check_residual_{axis}_m"] < 0.06, axis
    assert survey.cameras[0].focal_x == pytest.approx(1.015 * 24 * 1000 / np.hypot(36, 24), rel=2e-3)
    assert HEIGHT * 0.015 > 0.6, "held, the focal length would have moved the ground by this"


def straight_down(known: KnownSurvey, headings: np.ndarray) -> None:
    """Turn all views of a survey straight down."""
    known.angles[:, 0], known.angles[:, 1] = headings, -90.0
    known.truth[:, :, :3] = [world_from_camera(*angles) for angles in known.angles]
    known.stated_angles = known.angles + known.random.normal(0, GIMBAL_NOISE, known.angles.shape) + [YAW_BIAS, 0, 0]
    known.sightings = [known._sighted(pose) for pose in known.truth]


def move_principal_point(known: KnownSurvey, offset: np.ndarray) -> None:
    for seen in known.sightings:
        for number in seen:
            seen[number] = seen[number] + offset


def test_strips_to_and_fro_tell_the_principal_point_though_not_the_focal_length(run) -> None:
    """A principal point 20 px off tilts every view by 2 degrees where it is held."""
    known, offset = KnownSurvey(), np.array([17.0, -11.0])
    straight_down(known, known.angles[:, 0].copy())
    move_principal_point(known, offset)
    survey, context = run(known)
    assert context.figures["focal_length_rule"].startswith("held: only 0% of the views are oblique")
    assert context.figures["principal_point_rule"].startswith("free: views turned and tilted against one another")
    camera = survey.cameras[0]
    assert camera.focal_x == pytest.approx(FOCAL, abs=0.01), "EXIF's"
    np.testing.assert_allclose([camera.principal_x, camera.principal_y], np.array(SIZE) / 2 + offset, atol=1.0)
    assert np.median(known.angle_error(survey)) < ANGLE
    assert known.centre_error(survey).max() < CENTRE
    assert context.figures["gimbal_error_deg"] == pytest.approx(
        context.figures["gimbal_error_without_mount_deg"], abs=0.1
    )


def test_one_heading_leaves_the_principal_point_open(run) -> None:
    known = KnownSurvey()
    straight_down(known, 90.0 + known.random.normal(0, 1.0, known.count))
    survey, context = run(known)
    rule = context.figures["principal_point_rule"]
    assert rule == "held: views of such directions and positions leave it open to 9 px"
    assert survey.cameras[0].principal_x == SIZE[0] / 2
    assert known.centre_error(survey).max() < CENTRE


def test_one_pitch_leaves_the_lens_open(run) -> None:
    """Oblique views alone, all 45 degrees down, of a calibrated camera: pitch and lens can't be told apart."""
    known = KnownSurvey()
    known.angles[:, 0], known.angles[:, 1] = np.where(np.arange(known.count) // 5 % 2, 0.0, 180.0), -45.0
    known.truth[:, :, :3] = [world_from_camera(*angles) for angles in known.angles]
    known.stated_angles = known.angles + known.random.normal(0, GIMBAL_NOISE, known.angles.shape)
    known.sightings = [known._sighted(pose) for pose in known.truth]
    calibration = f" 2025-01-01;{FOCAL},{FOCAL},0,0,0,0,0,0,0"
    known.values = {index: {"DewarpData": calibration} for index in range(known.count)}
    survey, context = run(known)
    assert context.figures["focal_length_rule"] == "held: views of such directions and positions leave it open to 0.9%"
    assert (
        context.figures["principal_point_rule"] == "held: views of such directions and positions leave it open to 5 px"
    )
    assert known.centre_error(survey).max() < CENTRE
    assert np.median(known.angle_error(survey)) < 2 * ANGLE


def test_positions_of_some_metres_leave_the_tilt_to_the_gimbal(run) -> None:
    """Without RTK, straight down: positions alone tilt the survey by 12 degrees, the gimbal knows it to one."""
    known = KnownSurvey()
    straight_down(known, known.angles[:, 0].copy())
    known.stated_positions = known.positions + known.random.normal(0, [5.0, 5.0, 8.0], (known.count, 3))
    none = {"RtkFlag": "", "AltitudeType": "GpsFusionAlt", "RtkStdLon": "", "RtkStdLat": "", "RtkStdHgt": ""}
    known.values = dict.fromkeys(range(known.count), none)
    survey, context = run(known)
    up = survey.world_from_camera[:, 2, 2]
    assert np.degrees(np.arccos(-up)).max() < 2.0
    assert any("levelled by its gimbal angles" in text for text in context.warnings)
    assert context.figures["focal_length_rule"].startswith("held"), "noise of heights isn't several flying heights"
    assert str(appraise(survey).verdict).startswith("fly again")


def test_heights_of_another_level_count_for_little(run) -> None:
    """The second half has no RTK and heights above the sea, 48 m lower: below the ground."""
    known = KnownSurvey()
    none = {"RtkFlag": "0", "AltitudeType": "GpsFusionAlt", "RtkStdLon": "", "RtkStdLat": "", "RtkStdHgt": ""}
    for index in range(10, known.count):
        known.stated_positions[index, 2] -= 48.0
        known.values[index] = none
    survey, context = run(known)
    assert len(survey.photographs) == known.count
    assert known.centre_error(survey).max() < 2 * CENTRE
    assert np.median(known.angle_error(survey)) < ANGLE
    warning = next(text for text in context.warnings if "GpsFusionAlt" in text)
    assert "10 of 20 photographs have heights on a level that the file doesn't state" in warning
    assert "10.jpg" in warning


@pytest.mark.parametrize("offset", [[1.0, -0.8, 1.5], [0.0, 0.0, -48.0]], ids=["base station", "datum"])
def test_flights_on_two_datums_are_brought_together(run, offset: list[float]) -> None:
    """Both claim fixed positions of a centimetre, and one of them is wrong: nothing says which."""
    known = KnownSurvey()
    late = np.arange(known.count) >= known.count // 2
    known.stated_positions[late] += offset
    known.times = [time + timedelta(minutes=10) * bool(second) for time, second in zip(known.times, late, strict=True)]
    survey, context = run(known)
    assert known.centre_error(survey).max() < 2 * CENTRE, "where the first flight has it"
    assert np.median(known.angle_error(survey)) < ANGLE
    (warning,) = (text for text in context.warnings if "moved by" in text)
    assert "the positions of flight 2 (10 photographs)" in warning
    east, north, up = (float(number) for number in warning.partition("moved by ")[2].split(" m (")[0].split(","))
    np.testing.assert_allclose([east, north, up], -np.array(offset), atol=0.1)
    assert "10 positions contradict the others" in str(appraise(survey).verdict)


def test_a_single_strip_is_levelled_by_the_gimbal(run) -> None:
    """Three positions on one line leave the turn about it open: 25 degrees."""
    known = KnownSurvey(count=3)
    survey, context = run(known)
    assert known.angle_error(survey).max() < 2.0
    assert any("levelled by its gimbal angles" in text for text in context.warnings)


def unmatched(known: KnownSurvey, index: int) -> None:
    """Leave a photograph ten points, too few to be registered."""
    known.sightings[index] = dict(list(known.sightings[index].items())[:10])


def test_a_photograph_that_cant_be_registered_is_left_out_or_placed_by_its_metadata(run) -> None:
    known = KnownSurvey()
    unmatched(known, 7)
    survey, context = run(known, unregistered="metadata")
    (photograph,) = (photograph for photograph in survey.photographs if photograph.pose == "metadata")
    assert photograph.name == "07.jpg"
    assert len(survey.photographs) == known.count
    assert known.angle_error(survey)[7] < 4 * GIMBAL_NOISE, "its flight's bias of 1.6 degrees is gone"
    assert np.delete(known.angle_error(survey), 7).max() < 3 * ANGLE
    assert context.figures["registered_photographs"] == known.count - 1
    (warning,) = (text for text in context.warnings if "35 mm" not in text)
    assert "1 of 20 photographs couldn't be registered and are placed by their metadata" in warning
    assert "07.jpg" in warning
    assert "1 placed by their metadata alone (07.jpg)" in str(appraise(survey).verdict)


def test_control_of_other_photographs_is_refused(run, tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text(
        "name,latitude,longitude,ellipsoidal_height,photograph,column,row\nA,45.03,7.62,350,elsewhere.jpg,10,10\n"
    )
    with pytest.raises(InputError, match="none of the photographs"):
        run(KnownSurvey(), control=table)


def test_a_list_beside_the_photographs_is_used_without_being_named(
    tmp_path: Path, photograph, drone_metadata, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = KnownSurvey()
    folder = known.write(tmp_path / "photographs", photograph, drone_metadata)
    number = int(np.argmin(np.abs(known.points[:, :2]).max(axis=1)))
    latitude, longitude, height = geodetic_from_enu(known.points[[number]], ORIGIN)[0]
    seen = [(index, sighted[number]) for index, sighted in enumerate(known.sightings) if number in sighted]
    place = f"{longitude:.10f} {latitude:.10f} {height:.4f}"
    lines = [f"{place} {pixel[0]} {pixel[1]} {index:02d}.jpg A" for index, pixel in seen]
    (folder / "gcp_list.txt").write_text("\n".join(["EPSG:4326", *lines]))
    survey, context = known.locate(folder, tmp_path / "scratch", monkeypatch)
    assert context.figures["surveyed_points"] == 1
    assert survey.ground_points[0].sightings == len(seen) >= 4
    assert np.abs(survey.ground_points[0].residual).max() < 0.05


def test_surveyed_points_of_another_height_level_are_refused(run, surveyed) -> None:
    known = KnownSurvey()
    with pytest.raises(InputError, match=r"see the surveyed points \+0\.\d, [+-]0\.\d, \+48\.\d m") as error:
        run(known, control=surveyed(known, raised=-48.0))
    assert "geoid_offset" in str(error.value)
