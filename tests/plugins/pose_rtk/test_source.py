"""The whole stage on photographs with known truth, and on a real flight."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.demo import write_demo_survey
from slideframe.device import Device
from slideframe.errors import InputError
from slideframe.problem import Site
from slideframe.products import Georeference, Survey
from slideframe.stages import Context
from slideframe_pose_rtk.orientation import about_up, angle_between
from slideframe_pose_rtk.source import RtkPoses

# What the demo's metadata promise: RTK noise of 1 to 2 cm, gimbal noise of 0.3 degrees with a bias of 0.8.
TRUE_CENTRE = 0.03  # m rms per axis, from few and small photographs
TRUE_ANGLE = 0.1  # degrees, median
METADATA_ANGLE = 2.0  # degrees at most, bias and three sigmas
PHOTOGRAPHS = 12
# Mirafiori, a real flight, in pictures reduced from 1600 px that still determine the lens.
REAL_WIDTH = 1000  # px
REAL_ERROR = 0.5  # px; the whole pictures have 0.55 of their own, smaller, pixels
REAL_CENTRE = 0.03  # m rms per axis
REAL_GIMBAL = 1.0  # degrees, median, without the flight's yaw bias


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    write_demo_survey(folder / "survey", width=640, photograph_count=PHOTOGRAPHS)
    return folder / "survey"


def stop(*_: object) -> None:
    raise KeyboardInterrupt


def locate(
    photographs: Path, scratch: Path, source: RtkPoses | None = None, cache: Path | None = None
) -> tuple[Survey, Context]:
    scratch.mkdir(exist_ok=True)
    context = Context(device=Device(), scratch=scratch, cache=cache)
    site = Site(photographs=photographs)
    source = source or RtkPoses()
    source.preflight(site, context.device)
    return source.locate(site, context), context


def truth(demo: Path, survey: Survey) -> np.ndarray:
    """True poses in file order; the origin given to the stage is the truth's own."""
    cameras = json.loads((demo / "ground_truth" / "cameras.json").read_text())
    poses = cameras["world_from_camera"]
    names = [path.name for path in sorted((demo / "photographs").iterdir())]
    by_name = poses if isinstance(poses, dict) else dict(zip(names, poses, strict=True))
    return np.array([by_name[photograph.name] for photograph in survey.photographs])


@pytest.fixture(scope="module")
def source(demo: Path) -> RtkPoses:
    cameras = json.loads((demo / "ground_truth" / "cameras.json").read_text())
    return RtkPoses(origin=Georeference(**cameras["origin"]))


@pytest.fixture(scope="module")
def refined(demo: Path, source: RtkPoses, tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Context]:
    return locate(demo / "photographs", tmp_path_factory.mktemp("refined"), source, demo / "cache")


def test_cameras_are_where_they_were(demo: Path, refined: tuple[Survey, Context]) -> None:
    survey, context = refined
    true = truth(demo, survey)
    assert [photograph.path.name for photograph in survey.photographs] == sorted(
        path.name for path in (demo / "photographs").iterdir()
    )
    offset = survey.world_from_camera[:, :, 3] - true[:, :, 3]
    assert np.sqrt(np.mean(offset**2, axis=0)).max() < TRUE_CENTRE
    assert np.median(angle_between(survey.world_from_camera[:, :, :3], true[:, :, :3])) < TRUE_ANGLE
    assert context.figures["registered_photographs"] == PHOTOGRAPHS
    assert context.figures["reprojection_error_px"] < REAL_ERROR
    assert context.warnings == []


def test_points_are_seen_in_the_colours_of_the_photographs(refined: tuple[Survey, Context]) -> None:
    """Project the points with OpenCV's own formula, not COLMAP's code, and compare with the pictures."""
    survey, _ = refined
    camera, pose = survey.camera_of(0), survey.world_from_camera[0]
    x, y, depth = ((survey.sparse_points - pose[:, 3]) @ pose[:, :3]).T
    x, y = x / depth, y / depth
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    column = camera.focal_x * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera.principal_x
    row = camera.focal_y * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + camera.principal_y
    inside = (depth > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    assert inside.sum() > 100
    picture = np.asarray(Image.open(survey.photographs[0].path).convert("RGB"), np.float64)
    seen = picture[row[inside].astype(int), column[inside].astype(int)].mean(axis=1)
    correlation = np.corrcoef(seen, survey.sparse_colors[inside].mean(axis=1))[0, 1]
    assert correlation > 0.7, "points lie elsewhere, or have other colours"  # some are hidden, all are shaded


def test_an_interrupted_run_ends_with_the_same_bits(
    demo: Path, source: RtkPoses, refined: tuple[Survey, Context], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from slideframe_pose_rtk import correspondences

    with monkeypatch.context() as patch:
        patch.setattr(correspondences, "match_photographs", stop)
        with pytest.raises(KeyboardInterrupt):
            locate(demo / "photographs", tmp_path / "scratch", source)
    assert locate(demo / "photographs", tmp_path / "scratch", source)[0] == refined[0]


def test_the_papers_way_keeps_metadata_and_still_finds_points(demo: Path, source: RtkPoses, tmp_path: Path) -> None:
    paper = source.model_copy(update={"refine": False})
    survey, context = locate(demo / "photographs", tmp_path / "scratch", paper, demo / "cache")
    true = truth(demo, survey)
    assert angle_between(survey.world_from_camera[:, :, :3], true[:, :, :3]).max() < METADATA_ANGLE
    assert np.abs(survey.world_from_camera[:, :, 3] - true[:, :, 3]).max() < 0.1, "as good as RTK, no better"
    assert "centre_residual_up_m" not in context.figures, "zero by construction says nothing"
    assert len(survey.sparse_points) > 500
    heights = survey.sparse_points[:, 2]
    assert np.percentile(heights, 95) < true[:, 2, 3].min(), "the ground lies below the drone"


def test_photographs_with_faults_are_placed_or_named(demo: Path, source: RtkPoses, tmp_path: Path) -> None:
    folder = tmp_path / "photographs"
    shutil.copytree(demo / "photographs", folder)
    paths = sorted(folder.iterdir())
    unturned, upside_down, overturned, on_end, cut, dark = (paths[number] for number in (2, 3, 5, 6, 7, 9))
    # in place, because an APP1 segment states its length
    unturned.write_bytes(
        re.sub(rb'Gimbal\w+Degree="[^"]*"', lambda match: re.sub(rb"[1-9]", b"0", match[0]), unturned.read_bytes())
    )
    overturned.write_bytes(overturned.read_bytes().replace(b'GimbalRollDegree="+0', b'GimbalRollDegree="+9'))
    for path, turn in ((upside_down, Image.Transpose.ROTATE_180), (on_end, Image.Transpose.ROTATE_270)):
        with Image.open(path) as picture:
            picture.transpose(turn).save(path, exif=picture.getexif(), xmp=picture.info["xmp"], quality=95)
    cut.write_bytes(cut.read_bytes()[: len(cut.read_bytes()) // 2])
    with Image.open(dark) as picture:
        Image.new("RGB", picture.size).save(dark, exif=picture.getexif(), xmp=picture.info["xmp"])
    survey, context = locate(folder, tmp_path / "scratch", source, demo / "cache")
    left = {photograph.name for photograph in survey.photographs}
    assert {path.name for path in paths} - left == {cut.name, dark.name}
    true = truth(demo, survey)[:, :, :3]
    names = [photograph.name for photograph in survey.photographs]
    for path, turn in ((upside_down, 180.0), (on_end, -90.0)):
        true[names.index(path.name)] @= about_up(turn)
    errors = angle_between(survey.world_from_camera[:, :, :3], true)
    assert errors.max() < 3 * TRUE_ANGLE, "the turned ones too, since their principal points are turned with them"
    warned = "\n".join(context.warnings)
    for path in (unturned, cut, dark):
        assert path.name in warned
    assert "cut off" in warned
    assert any("turned by 180 degrees" in line and upside_down.name in line for line in context.warnings)
    assert any("turned by 270 degrees" in line and on_end.name in line for line in context.warnings)


def test_too_little_in_common_is_an_input_error(demo: Path, source: RtkPoses, tmp_path: Path) -> None:
    """Three photographs of the same place, of which one is blank."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for path in sorted((demo / "photographs").iterdir())[:3]:
        shutil.copy(path, folder)
    with Image.open(path) as picture:
        Image.new("RGB", picture.size).save(folder / path.name, exif=picture.getexif(), xmp=picture.info["xmp"])
    with pytest.raises(InputError, match="at least 3 photographs"):
        locate(folder, tmp_path / "scratch", source)


@pytest.mark.slow
def test_a_real_flight(shared: Path, tmp_path: Path) -> None:
    """Nadir strips, so that the focal length is held, while strips to and fro tell the principal point."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for path in sorted((shared / "data/uav/mirafiori_rtk/images").glob("*.JPG")):
        with Image.open(path) as picture:
            size = REAL_WIDTH, round(REAL_WIDTH * picture.height / picture.width)
            reduced = picture.resize(size, Image.Resampling.LANCZOS)
            reduced.save(folder / path.name, quality=92, exif=picture.getexif(), xmp=picture.info["xmp"])
    survey, context = locate(folder, tmp_path / "scratch")
    assert context.figures["registered_photographs"] == 32
    assert context.figures["reprojection_error_px"] <= REAL_ERROR
    for axis in ("east", "north", "up"):
        assert context.figures[f"centre_residual_{axis}_m"] <= REAL_CENTRE
    assert context.figures["gimbal_error_deg"] <= REAL_GIMBAL
    assert context.figures["rtk_fixed_share"] == 1.0
    assert context.figures["focal_length_rule"].startswith("held: only 0% of the views are oblique")
    assert context.figures["principal_point_rule"].startswith("free")
    assert survey.cameras[0].focal_x == pytest.approx(1973.0899658 * REAL_WIDTH / 1600), "as DewarpData has it"


def test_added_photographs_are_the_only_ones_computed(
    demo: Path,
    source: RtkPoses,
    refined: tuple[Survey, Context],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from slideframe_pose_rtk import correspondences, features, matching

    calls = {"photographs": 0, "pairs": 0}

    def count(module: object, name: str, key: str) -> None:
        original = getattr(module, name)

        def counted(*given: object) -> object:
            calls[key] += 1
            return original(*given)

        monkeypatch.setattr(module, name, counted)

    count(features, "_extract", "photographs")
    count(matching, "_match_pair", "pairs")
    paths = sorted((demo / "photographs").iterdir())
    folder = tmp_path / "photographs"
    folder.mkdir()
    for path in paths[:-1]:
        shutil.copy(path, folder)
    with monkeypatch.context() as patch:  # features and matches alone
        patch.setattr(correspondences, "triangulate", stop)
        with pytest.raises(KeyboardInterrupt):
            locate(folder, tmp_path / "first", source, tmp_path / "cache")
    assert calls["photographs"] == PHOTOGRAPHS - 1
    pairs = calls["pairs"]
    shutil.copy(paths[-1], folder)
    grown, _ = locate(folder, tmp_path / "second", source, tmp_path / "cache")
    assert calls["photographs"] == PHOTOGRAPHS
    assert calls["pairs"] - pairs < PHOTOGRAPHS, "only those with the new photograph"
    assert np.array_equal(grown.world_from_camera, refined[0].world_from_camera), "the cache changes nothing"
    assert np.array_equal(grown.sparse_points, refined[0].sparse_points)
