from datetime import UTC, datetime
from pathlib import Path

from slideframe.stages import Context
from slideframe_pose_rtk.metadata import PhotoRecord
from slideframe_pose_rtk.twins import without_twins

NOON = datetime(2024, 5, 3, 12, tzinfo=UTC)


def record(name: str, **changes: object) -> PhotoRecord:
    values = {"size": (4000, 3000), "utc": NOON, "latitude": 22.3, "longitude": 114.2, "exposure_time": 0.001}
    return PhotoRecord(path=Path(name), **values | changes)


def test_the_largest_copy_stays(context: Context) -> None:
    small, large, again = record("small.jpg", size=(800, 600)), record("large.jpg"), record("again.jpg")
    assert without_twins([small, large, again], context) == [large]
    assert len(context.warnings) == 2
    assert all("large.jpg" in warning for warning in context.warnings)


def test_other_exposures_stay(context: Context) -> None:
    records = [
        record("a.jpg"),
        record("bracket.jpg", exposure_time=0.004),
        record("other_camera.jpg", image_source="InfraredCamera"),
        record("elsewhere.jpg", latitude=22.4),
        record("later.jpg", utc=NOON.replace(second=2)),
        record("untimed.jpg", utc=None),
        record("untimed_too.jpg", utc=None),
    ]
    assert without_twins(records, context) == records
    assert not context.warnings
