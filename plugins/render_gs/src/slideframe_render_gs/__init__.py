"""Films of moving Gaussian splats."""

from slideframe.hookspecs import hookimpl
from slideframe_render_gs.renderer import SplatRenderer


@hookimpl
def slideframe_stage() -> type[SplatRenderer]:
    """Offer the stage."""
    return SplatRenderer
