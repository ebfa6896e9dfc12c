"""What every pose source must hold, against the demo survey's true cameras."""

import hashlib
from functools import cache
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Georeference, Survey
from slideframe.stages import PoseSource
from slideframe.testing.evidence import assert_same, assert_valid, fresh_context
from slideframe.testing.survey_scenes import demo_site, site_truth

# The survey's RTK noise is centimetres; photographs 640 pixels wide allow for the rest.
POSITION_TOLERANCE_M = 0.3
ROTATION_TOLERANCE_DEGREES = 1.0
ROUNDING = 1e-6
# Mean radius is enough to compare two origins a few metres apart.
EARTH_RADIUS_M = 6_371_000.0


def check_input_files_are_complete(stage: PoseSource, scratch: Path) -> None:
    """The declared input files exist and include every photograph used."""
    files = [Path(file) for file in stage.input_files(demo_site())]
    missing = [file for file in files if not file.is_file()]
    assert not missing, f"input_files names files that aren't there: {missing}"
    used = {photograph.path.resolve() for photograph in _survey(stage).photographs}
    unnamed = used - {file.resolve() for file in files}
    assert not unnamed, f"photographs used but not named by input_files: {unnamed}"


def check_survey_is_valid(stage: PoseSource, scratch: Path) -> None:
    """The survey has the declared arrays, proper rotations and the photographs' true digests."""
    survey = _survey(stage)
    assert_valid(survey)
    rotations = survey.world_from_camera[:, :, :3]
    skew = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max()
    assert skew <= ROUNDING, f"a pose's rotation is off orthonormal by {skew:.2e}"
    assert (np.linalg.det(rotations) > 0).all(), "a pose mirrors"
    for photograph in survey.photographs:
        got = hashlib.sha256(photograph.path.read_bytes()).hexdigest()
        assert got == photograph.sha256, f"{photograph.name}: the recorded digest isn't that of the file"


def check_every_photograph_is_located(stage: PoseSource, scratch: Path) -> None:
    """All photographs of a sound survey are there, once each."""
    names = [photograph.name for photograph in _survey(stage).photographs]
    expected = set(site_truth()["world_from_camera"])
    assert len(names) == len(set(names)), "a photograph appears twice"
    assert set(names) == expected, f"photographs lost: {expected - set(names)}"


def check_poses_are_true(stage: PoseSource, scratch: Path) -> None:
    """Cameras stand and look as they did."""
    survey, truth = _survey(stage), site_truth()
    shift = _offset(survey.georeference, Georeference(**truth["origin"]))
    for index, photograph in enumerate(survey.photographs):
        expected = np.array(truth["world_from_camera"][photograph.name])
        got = survey.world_from_camera[index]
        distance = float(np.linalg.norm(got[:, 3] + shift - expected[:, 3]))
        assert distance <= POSITION_TOLERANCE_M, f"{photograph.name} stands {distance:.3f} m from the truth"
        cosine = (np.trace(got[:, :3].T @ expected[:, :3]) - 1) / 2
        angle = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        assert angle <= ROTATION_TOLERANCE_DEGREES, f"{photograph.name} looks {angle:.2f} degrees off the truth"


def check_two_runs_are_equal(stage: PoseSource, scratch: Path) -> None:
    """Locating the same photographs again gives the same bits."""
    assert_same(_survey(stage), stage.locate(demo_site(), fresh_context(scratch)), "second run")


@cache
def _survey(stage: PoseSource) -> Survey:
    """Locate once and let all checks look at the result."""
    import tempfile

    with tempfile.TemporaryDirectory(prefix="slideframe-check-") as folder:
        return stage.locate(demo_site(), fresh_context(Path(folder)))


def _offset(origin: Georeference, other: Georeference) -> Float64Array:
    """Return the east, north and up of `origin` as seen from `other`, m, for points a few metres apart."""
    north = np.radians(origin.latitude - other.latitude) * EARTH_RADIUS_M
    east = np.radians(origin.longitude - other.longitude) * EARTH_RADIUS_M * np.cos(np.radians(other.latitude))
    return np.array([east, north, origin.ellipsoidal_height - other.ellipsoidal_height])
