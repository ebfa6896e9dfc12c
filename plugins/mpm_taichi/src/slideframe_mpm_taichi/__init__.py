"""Material Point Method in Taichi."""

from slideframe.hookspecs import hookimpl
from slideframe_mpm_taichi.solver import TaichiSolver


@hookimpl
def slideframe_stage() -> type[TaichiSolver]:
    """Offer the stage."""
    return TaichiSolver
