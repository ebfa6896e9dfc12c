from slideframe.hookspecs import hookimpl
from slideframe_standins.stages import OtherSolver


@hookimpl
def slideframe_stage() -> type[OtherSolver]:
    return OtherSolver
