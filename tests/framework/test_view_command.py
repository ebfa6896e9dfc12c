"""`slideframe view` starts the viewer on the right file, and says when there is none."""

import subprocess

import pytest

from slideframe.cli import main
from slideframe.run_folder import RECORDING


@pytest.fixture
def started(monkeypatch) -> list[list[str]]:
    calls: list[list[str]] = []
    monkeypatch.setattr(subprocess, "call", lambda command: calls.append(command) or 0)
    return calls


def test_a_run_s_recording_is_opened_or_served_to_this_machine_alone(tmp_path, started):
    (tmp_path / RECORDING).touch()
    assert main(["view", str(tmp_path)]) == 0
    assert main(["view", str(tmp_path / RECORDING), "--web"]) == 0
    assert started[0][1:] == ["-m", "rerun", str(tmp_path / RECORDING)]
    assert started[1][3:] == [str(tmp_path / RECORDING), "--serve-web", "--bind", "127.0.0.1"]


def test_a_folder_without_a_recording_is_said(tmp_path, started, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "there is no recording" in capsys.readouterr().err
    assert not started


def test_ctrl_c_ends_the_serving(tmp_path, monkeypatch):
    (tmp_path / RECORDING).touch()

    def interrupted(command):
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "call", interrupted)
    assert main(["view", str(tmp_path), "--web"]) == 0
