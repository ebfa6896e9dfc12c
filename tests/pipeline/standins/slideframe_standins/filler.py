from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import StandinFiller


@hookimpl
def slideframe_stage() -> type[StandinFiller]:
    return StandinFiller
