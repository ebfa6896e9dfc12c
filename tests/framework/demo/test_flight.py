"""Gimbal angles, and the statistics of what RTK and gimbal report."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from slideframe.demo.flight import GIMBAL_NOISE, YAW_BIAS, fly, rotation_from_gimbal

SHARED = Path(os.environ.get("SLIDEFRAME_SHARED", Path(__file__).parents[4] / "shared"))
GOLDEN_TOLERANCE = 1e-8  # the vectors are written to nine decimals


def test_gimbal_equals_the_golden_vectors():
    path = SHARED / "data/golden_pose_vectors.json"
    if not path.is_file():
        pytest.skip(f"no {path}")
    for vector in json.loads(path.read_text()):
        rotation = rotation_from_gimbal(vector["yaw"], vector["pitch"], vector["roll"])
        np.testing.assert_allclose(rotation.T, vector["R_cam_from_world"], atol=GOLDEN_TOLERANCE)


def test_gimbal_looks_where_it_should():
    # heading 30 degrees, 60 degrees down: east, north, up of the optical axis and of the picture's right side
    rotation = rotation_from_gimbal(30, -60, 0)
    np.testing.assert_allclose(rotation[:, 2], [0.25, np.sqrt(3) / 4, -np.sqrt(3) / 2], atol=1e-15)
    np.testing.assert_allclose(rotation[:, 0], [np.sqrt(3) / 2, -0.5, 0], atol=1e-15)
    # a roll to the right lowers the picture's right side
    assert rotation_from_gimbal(30, -60, 10)[2, 0] < -0.08
    np.testing.assert_allclose(rotation_from_gimbal(72, -90, 180), rotation_from_gimbal(252, -90, 0), atol=1e-15)


def test_reported_positions_scatter_as_they_say():
    flights = [fly(seed=seed) for seed in range(20)]
    errors = np.concatenate([flight.reported_positions - flight.positions for flight in flights])
    sigma = np.concatenate([flight.position_sigma for flight in flights])
    assert 0.009 < sigma.min() < sigma.max() < 0.025
    normalised = errors / sigma
    # 640 draws: the standard error of the mean is 0.04, that of the deviation 0.03; four of them
    np.testing.assert_allclose(normalised.mean(axis=0), 0, atol=0.16)
    np.testing.assert_allclose(normalised.std(axis=0), 1, atol=0.12)


def test_reported_angles_have_one_bias_in_yaw():
    flights = [fly(seed=seed) for seed in range(20)]
    errors = np.concatenate([flight.reported_angles - flight.angles for flight in flights])
    errors[:, 0] = (errors[:, 0] + 180) % 360 - 180
    # standard error 0.012 degrees, rounding to tenths adds nothing to the mean
    np.testing.assert_allclose(errors.mean(axis=0), [YAW_BIAS, 0, 0], atol=0.05)
    np.testing.assert_allclose(errors.std(axis=0), GIMBAL_NOISE, atol=0.04)
    reported = flights[0].reported_angles
    np.testing.assert_allclose(reported * 10, np.round(reported * 10), atol=1e-9)


def test_flight_has_heights_and_headings_of_every_kind():
    flight = fly()
    oblique = flight.angles[:, 1] > -80
    assert 8 <= (~oblique).sum() <= 12
    headings = np.abs(np.sin(np.radians(flight.angles[oblique, 0])))
    assert (headings > 0.1).all()  # none at 0 or 180, where a transposed rotation hides
    assert np.ptp(flight.positions[:, 2]) > 35
    np.testing.assert_allclose(flight.positions.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(fly(7).positions.mean(axis=0), 0, atol=1e-12)
