from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import StandinRenderer


@hookimpl
def slideframe_stage() -> type[StandinRenderer]:
    return StandinRenderer
