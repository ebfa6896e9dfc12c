"""Material Point Method in Warp."""

from slideframe.hookspecs import hookimpl
from slideframe_mpm_warp.solver import WarpSolver


@hookimpl
def slideframe_stage() -> type[WarpSolver]:
    """Offer the stage."""
    return WarpSolver
