"""RTK drone metadata to georeferenced cameras."""

from slideframe.hookspecs import hookimpl
from slideframe_pose_rtk.source import RtkPoses


@hookimpl
def slideframe_stage() -> type[RtkPoses]:
    """Offer the stage."""
    return RtkPoses
