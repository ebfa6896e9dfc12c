"""The flights that a survey is made of: photographs of one drone without a longer pause between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import numpy.typing as npt

from slideframe_pose_rtk.metadata import PhotoRecord

# The compass is read anew when batteries are changed, which takes minutes; a drone in flight pauses for less.
LONGEST_PAUSE = 300.0  # s

IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Session:
    """One flight: `name` for people, and the photographs' indices in order of capture."""

    name: str
    indices: IndexArray


def sessions_of(records: Sequence[PhotoRecord]) -> tuple[Session, ...]:
    """Split photographs by drone, by the flight that their files state, and at pauses of five minutes.

    Cameras of one drone share its compass and so their session. Photographs without a time stay together.
    """
    groups: dict[tuple[str, ...], list[int]] = {}
    for index, record in enumerate(records):
        groups.setdefault((record.drone or f"{record.make} {record.model}", record.flight), []).append(index)
    parts = [part for group in groups.values() for part in _split_at_pauses(records, group)]
    parts.sort(key=lambda part: min(part))
    return tuple(Session(f"flight {number}", np.array(part, np.int64)) for number, part in enumerate(parts, 1))


def capture_order(records: Sequence[PhotoRecord]) -> list[int]:
    """Return the photographs' indices in the order in which each drone took them."""
    return [int(index) for session in sessions_of(records) for index in session.indices]


def _split_at_pauses(records: Sequence[PhotoRecord], group: list[int]) -> list[list[int]]:
    times = {index: _seconds(records[index]) for index in group}
    timed = sorted((index for index in group if times[index] is not None), key=lambda index: (times[index], index))
    parts: list[list[int]] = [[index for index in group if times[index] is None]]
    last = None
    for index in timed:
        now = times[index]
        assert now is not None
        if last is None or now - last > LONGEST_PAUSE:
            parts.append([])
        parts[-1].append(index)
        last = now
    return [part for part in parts if part]


def _seconds(record: PhotoRecord) -> float | None:
    """Return the instant of exposure; the camera's clock serves where UTC isn't stated: only differences count."""
    instant = record.utc or record.local_time
    if not isinstance(instant, datetime):
        return None
    return (instant if instant.tzinfo else instant.replace(tzinfo=UTC)).timestamp()
