"""Three lines hold the whole contract."""

from collections.abc import Callable

from slideframe_mpm_flip.solver import FlipSolver

from slideframe.testing import parametrize_with_checks


@parametrize_with_checks(FlipSolver())
def test_conformance(check: Callable[[], None]) -> None:
    """The solver holds what every solver must."""
    check()
