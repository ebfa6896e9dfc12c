from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slideframe.products import Camera
from slideframe_pose_rtk.ground import footprint, ground_height
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.orientation import world_from_camera
from slideframe_pose_rtk.pairs import choose_pairs

LENS = Camera(width=800, height=600, focal_x=554, focal_y=554, principal_x=400, principal_y=300)
PER_STRIP = 10


class Flight(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.positions)


def flight_of(positions: np.ndarray, angles: list[tuple[float, float, float]], stated: float | None) -> Flight:
    record = PhotoRecord(path=Path("a"), size=(800, 600), height_above_takeoff=stated)
    return Flight(
        positions=np.asarray(positions, np.float64),
        rotations=np.array([world_from_camera(*one) for one in angles]),
        oriented=np.ones(len(positions), bool),
        cameras=(LENS,),
        camera_of=(0,) * len(positions),
        records=[record] * len(positions),
    )


def strips(height: float, stated: float | None, overlap: float = 0.75, count: int = 4 * PER_STRIP) -> Flight:
    """Nadir strips to and fro, along the pictures' shorter side, `height` above ground at zero."""
    index = np.arange(count)
    along, across = height * 600 / 554 * (1 - overlap), height * 800 / 554 * 0.35
    positions = np.column_stack([index % PER_STRIP * along, index // PER_STRIP * across, np.full(count, height)])
    return flight_of(positions, [(90.0 if one // PER_STRIP % 2 else 270.0, -90.0, 0.0) for one in index], stated)


def orbit(radius: float, height: float, stated: float | None) -> Flight:
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    positions = np.column_stack([radius * np.sin(around), radius * np.cos(around), np.full(24, height)])
    pitch = -float(np.degrees(np.arctan2(height, radius)))
    return flight_of(positions, [(float(np.degrees(one)) + 180.0, pitch, 0.0) for one in around], stated)


def test_heights_above_take_off_tell_it() -> None:
    assert ground_height(strips(45.0, stated=45.0)) == 0.0
    assert ground_height(strips(45.0, stated=60.0)) == -15.0


@given(st.floats(10.0, 300.0))
def test_overlap_tells_it_where_nothing_is_stated(height: float) -> None:
    """At 75 % of overlap, 70 % are reached a sixth above the ground; steps of height and of rays come on top."""
    assert abs(ground_height(strips(height, stated=None)) / height) < 0.35


def test_an_orbit_looks_where_its_axes_meet() -> None:
    assert abs(ground_height(orbit(60.0, 60.0, stated=None))) < 0.15 * 60.0
    assert abs(ground_height(orbit(60.0, 30.0, stated=None))) < 0.4 * 30.0


def test_take_off_from_a_hill_top_is_seen_through() -> None:
    """The drone states 8 m above take-off, and flies 80 m above the valley that it photographs."""
    believed = ground_height(strips(80.0, stated=8.0))
    assert abs(believed) < 30.0


def test_strips_hang_together_without_any_height() -> None:
    """Files without XMP: with the ground 5 m below the drone no photograph would look at its neighbour's."""
    pairs = choose_pairs(strips(80.0, stated=None), 10)
    across = {one for pair in pairs if pair[0] // PER_STRIP != pair[1] // PER_STRIP for one in pair}
    assert len(across) == 4 * PER_STRIP


def test_one_photograph_shows_ground_below_it() -> None:
    flight = strips(45.0, stated=45.0, count=1)
    points = footprint(flight, 0, ground_height(flight), 4)
    assert len(points) == 16
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(points[:, 0]), 0.75 * 45.0 * 600 / 554, rtol=1e-9)


@pytest.mark.parametrize("stated", [None, 45.0])
def test_a_single_photograph_has_no_overlap_to_go_by(stated: float | None) -> None:
    assert ground_height(strips(45.0, stated=stated, count=1)) == (0.0 if stated else 40.0)
