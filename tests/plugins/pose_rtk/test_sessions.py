from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.sessions import capture_order, sessions_of

START = datetime(2026, 1, 26, 9, 0, tzinfo=UTC)


def record(minute: float | None, **fields: object) -> PhotoRecord:
    utc = None if minute is None else START + timedelta(minutes=minute)
    return PhotoRecord(path=Path("a.jpg"), size=(4, 3), utc=utc, **fields)


def indices(*records: PhotoRecord) -> list[list[int]]:
    return [session.indices.tolist() for session in sessions_of(records)]


def test_a_pause_of_five_minutes_parts_flights() -> None:
    assert indices(record(0), record(1), record(5.9), record(11), record(12)) == [[0, 1, 2], [3, 4]]


def test_drones_are_apart_and_cameras_of_one_drone_are_not() -> None:
    first, second = {"drone": "A", "model": "wide"}, {"drone": "A", "model": "tele"}
    assert indices(record(0, **first), record(0, drone="B"), record(0.1, **second)) == [[0, 2], [1]]
    assert indices(record(0, model="M3E"), record(0, model="M3T")) == [[0], [1]]


def test_the_flight_that_files_state_counts() -> None:
    assert indices(record(0, flight="1"), record(1, flight="2"), record(2, flight="1")) == [[0, 2], [1]]


def test_order_is_that_of_capture_and_untimed_photographs_stay_together() -> None:
    records = [record(2), record(None), record(0), record(None), record(1)]
    assert indices(*records) == [[2, 4, 0], [1, 3]]
    assert capture_order(records) == [2, 4, 0, 1, 3]


def test_the_cameras_clock_serves_without_utc() -> None:
    records = [record(None).model_copy(update={"local_time": datetime(2026, 1, 26, 9, minute)}) for minute in (0, 30)]
    assert indices(*records) == [[0], [1]]


@pytest.mark.parametrize("count", [1, 3])
def test_names_count_from_one(count: int) -> None:
    sessions = sessions_of([record(10.0 * index) for index in range(count)])
    assert [session.name for session in sessions] == [f"flight {number}" for number in range(1, count + 1)]
