"""Lines pass within their tolerance, and a card can fail."""

import json
import math
from dataclasses import replace

import pytest

from slideframe.errors import StageFailed
from slideframe.reference.solver import ReferenceSolver
from slideframe.verification import contact
from slideframe.verification.card import Line, row, summary
from slideframe.verification.case import Case
from slideframe.verification.rig import Rig
from slideframe.verification.suite import CASES, cases

LINE = Line("settlement", "mm", 10.0, 10.1, 0.2, "theory")


def test_a_line_passes_within_its_tolerance():
    assert LINE.passed
    assert replace(LINE, got=9.8).passed
    assert not replace(LINE, got=10.3).passed
    assert not replace(LINE, got=math.nan).passed
    assert not replace(LINE, expected=math.nan).passed


def test_a_failed_line_says_so():
    assert row(LINE).startswith("ok")
    assert row(replace(LINE, got=11)).startswith("FAILED")
    assert summary("mine", [LINE, replace(LINE, got=11)]) == "mine: 1 of 2 lines hold, 1 FAILED"


def test_numbers_that_are_not_there_become_null():
    entry = replace(LINE, got=math.nan).as_json("mine")
    assert json.loads(json.dumps(entry, allow_nan=False))["got"] is None
    assert entry["passed"] is False


def test_a_case_that_the_solver_refuses_is_a_line_that_failed():
    def refuses(rig):
        raise StageFailed("no such wall")
        yield

    (line,) = Case("a wall", refuses).lines(Rig(ReferenceSolver()))
    assert not line.passed
    assert (line.name, line.note) == ("a wall", "no such wall")


def test_the_fast_part_is_a_part():
    fast = list(cases(fast=True))
    assert 0 < len(fast) < len(CASES)
    assert set(fast) <= set(cases(fast=False))


def test_names_are_unique():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)


class Heavy(ReferenceSolver):
    """A solver with one percent too much gravity."""

    def solve(self, filling, problem, context):
        gravity = tuple(1.01 * component for component in problem.simulation.gravity)
        simulation = problem.simulation.model_copy(update={"gravity": gravity})
        yield from super().solve(filling, problem.model_copy(update={"simulation": simulation}), context)


@pytest.mark.parametrize("measure", [contact.coulomb_blocks, contact.frictionless_block])
def test_a_wrong_solver_fails(measure):
    """Negative control of the tightest lines."""
    assert not any(line.passed for line in measure(Rig(Heavy())))
