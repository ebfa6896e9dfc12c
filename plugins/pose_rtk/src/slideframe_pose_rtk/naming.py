"""How messages name photographs."""

from collections.abc import Iterable

from slideframe_pose_rtk.metadata import PhotoRecord


def names(records: Iterable[PhotoRecord], most: int = 5) -> str:
    """List file names for a message."""
    all_names = [record.path.name for record in records]
    more = f" and {len(all_names) - most} more" if len(all_names) > most else ""
    return ", ".join(all_names[:most]) + more
