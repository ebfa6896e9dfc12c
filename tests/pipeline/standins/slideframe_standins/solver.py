from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import StandinSolver


@hookimpl
def slideframe_stage() -> type[StandinSolver]:
    return StandinSolver
