"""Material Point Method with a PIC/FLIP transfer."""

from slideframe.hookspecs import hookimpl
from slideframe_mpm_flip.solver import FlipSolver


@hookimpl
def slideframe_stage() -> type[FlipSolver]:
    """Offer the stage."""
    return FlipSolver
