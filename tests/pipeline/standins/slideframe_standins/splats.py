from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import StandinSplats


@hookimpl
def slideframe_stage() -> type[StandinSplats]:
    return StandinSplats
