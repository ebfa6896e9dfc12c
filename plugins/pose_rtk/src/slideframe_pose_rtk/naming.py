"""How messages name photographs."""

from collections.abc import Iterable, Sequence

from slideframe_pose_rtk.metadata import PhotoRecord


def names(records: Iterable[PhotoRecord], most: int = 5) -> str:
    """List file names for a message."""
    return listing([record.path.name for record in records], most)


def listing(words: Sequence[str], most: int = 5) -> str:
    """List the first words and count the others."""
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
