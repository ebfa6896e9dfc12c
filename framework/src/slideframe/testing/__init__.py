"""The conformance kit: what every plugin must hold, as tests anyone can run.

from slideframe.testing import parametrize_with_checks
from mypackage.solver import MySolver

@parametrize_with_checks(MySolver())
def test_conformance(check):
    check()
"""

from slideframe.testing.kit import Check, check_stage, checks_for, parametrize_with_checks

__all__ = ["Check", "check_stage", "checks_for", "parametrize_with_checks"]
