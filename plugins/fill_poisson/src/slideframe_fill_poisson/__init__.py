"""Soil volume below a Poisson surface."""

from slideframe.hookspecs import hookimpl
from slideframe_fill_poisson.filler import PoissonFiller


@hookimpl
def slideframe_stage() -> type[PoissonFiller]:
    """Offer the stage."""
    return PoissonFiller
