from pathlib import Path
from types import SimpleNamespace

import numpy as np

from slideframe.products import Camera
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.orientation import world_from_camera
from slideframe_pose_rtk.pairs import choose_pairs, shared_view

LENS = Camera(width=800, height=600, focal_x=554, focal_y=554, principal_x=400, principal_y=300)
HEIGHT = 45.0


class Flight(SimpleNamespace):
    """As much of a flight as pairs are chosen by."""

    def __len__(self) -> int:
        return len(self.positions)


def strips(along: float, across: float, per_strip: int, count: int) -> Flight:
    index = np.arange(count)
    strip = index // per_strip
    return Flight(
        positions=np.column_stack([index % per_strip * along, strip * across, np.full(count, HEIGHT)]),
        rotations=np.array([world_from_camera(90 if one % 2 else 270, -90, 0) for one in strip]),
        oriented=np.ones(count, bool),
        cameras=(LENS,),
        camera_of=(0,) * count,
        records=[PhotoRecord(path=Path("a"), size=(800, 600), height_above_takeoff=HEIGHT) for _ in index],
    )


def test_the_share_of_ground_in_common() -> None:
    """Two nadir views 65 m wide and half of that apart along the picture's side share half of their ground."""
    width = HEIGHT * 800 / 554
    flight = strips(along=width / 2, across=0, per_strip=2, count=2)
    flight.rotations = np.array([world_from_camera(0, -90, 0)] * 2)
    score = shared_view(flight)
    np.testing.assert_allclose(score, [[0, 0.5], [0.5, 0]], atol=1e-12)


def test_strips_hang_together_however_many_neighbours_there_are_along_them() -> None:
    """Every 3 m along a strip there are 10 better neighbours than any of the next strip, 15 m away."""
    flight = strips(along=3.0, across=15.0, per_strip=20, count=60)
    pairs = choose_pairs(flight, 10)
    across = {photograph for first, second in pairs if first // 20 != second // 20 for photograph in (first, second)}
    assert len(across) > 50
    assert len(pairs) < 60 * 10


def test_photographs_of_unknown_orientation_choose_their_nearest() -> None:
    flight = strips(along=10.0, across=10.0, per_strip=5, count=15)
    flight.oriented[7] = False
    partners = {first + second - 7 for first, second in choose_pairs(flight, 2) if 7 in (first, second)}
    assert partners >= {2, 6, 8, 12}


def test_photographs_taken_in_turn_are_compared_even_where_a_position_is_false() -> None:
    flight = strips(along=10.0, across=10.0, per_strip=5, count=10)
    flight.positions[3] += [0.0, 900.0, 0.0]
    assert {(2, 3), (3, 4)} <= set(choose_pairs(flight, 4))
