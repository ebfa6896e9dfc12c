"""`slideframe verify` as a user calls it."""

import json

import pytest

from slideframe.cli import main
from slideframe.commands import verify
from slideframe.verification import invariance
from slideframe.verification.card import Line
from slideframe.verification.case import Case

GOOD, BAD = Line("good", "m", 1.0, 1.0, 0.1, "theory"), Line("bad", "m", 1.0, 2.0, 0.1, "theory")


@pytest.fixture
def card(monkeypatch):
    """Put lines in the place of the cases."""

    def show(*lines):
        monkeypatch.setattr(verify, "cases", lambda fast: [Case("stand-in", lambda rig: iter(lines))])

    return show


def test_a_card_that_holds_exits_with_0(card, capsys):
    card(GOOD)
    assert main(["verify", "--solver", "reference"]) == 0
    assert "reference: 1 of 1 lines hold" in capsys.readouterr().out


def test_a_line_that_fails_makes_the_exit_code(card, capsys):
    card(GOOD, BAD)
    assert main(["verify", "--solver", "reference"]) == 4
    assert "FAILED  bad, m" in capsys.readouterr().out


def test_json_is_a_list_of_lines(card, capsys):
    card(GOOD, BAD)
    assert main(["verify", "--solver", "reference", "--json"]) == 4
    rows = json.loads(capsys.readouterr().out)
    assert [row["passed"] for row in rows] == [True, False]
    assert rows[0].keys() >= {"name", "expected", "got", "tolerance", "passed", "source"}


def test_a_real_case_becomes_json(monkeypatch, capsys):
    """NumPy's numbers aren't JSON's."""
    monkeypatch.setattr(verify, "cases", lambda fast: invariance.CASES)
    assert main(["verify", "--solver", "mpm_warp", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == len(invariance.CASES)


def test_without_a_name_every_solver_is_checked(card, capsys):
    card(GOOD)
    assert main(["verify", "--json"]) == 0
    solvers = [row["solver"] for row in json.loads(capsys.readouterr().out)]
    assert {"reference", "mpm_warp", "mpm_taichi"} <= set(solvers)
    assert len(solvers) == len(set(solvers))


def test_a_stage_of_another_kind_is_refused(capsys):
    assert main(["verify", "--solver", "pose_rtk"]) == 2
    assert "is a pose_source, not a solver" in capsys.readouterr().err


def test_an_unknown_solver_is_refused(capsys):
    assert main(["verify", "--solver", "mpm_wrap"]) == 2
    assert "did you mean 'mpm_warp'?" in capsys.readouterr().err
