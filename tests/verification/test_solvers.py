"""The fast part of the verification card, for every solver."""

import pytest

from slideframe.verification.suite import cases


@pytest.mark.parametrize("case", tuple(cases(fast=True)), ids=lambda case: case.name)
def test_every_line_holds(rig, case):
    lines = list(case.lines(rig))
    assert lines
    for line in lines:
        assert line.passed, line
