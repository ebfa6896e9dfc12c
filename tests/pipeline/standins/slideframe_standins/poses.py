from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import StandinPoses


@hookimpl
def slideframe_stage() -> type[StandinPoses]:
    return StandinPoses
