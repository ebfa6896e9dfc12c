"""Gaussian splats that were trained elsewhere."""

from slideframe.hookspecs import hookimpl
from slideframe_gs_import.reconstructor import ImportedSplats


@hookimpl
def slideframe_stage() -> type[ImportedSplats]:
    """Offer the stage."""
    return ImportedSplats
