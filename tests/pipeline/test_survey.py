"""`slideframe survey` with a stand-in pose source, in this process."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.cli import main


@pytest.fixture
def photographs(tmp_path: Path, standins: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SLIDEFRAME_TEST_CALLS", str(tmp_path / "calls"))
    folder = tmp_path / "slope"
    folder.mkdir()
    for index in range(3):
        Image.fromarray(np.full((30, 40, 3), 60 * index, np.uint8)).save(folder / f"{index}.jpg")
    return folder


def test_the_report_stands_alone(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["survey", str(photographs), "--pose-source", "standin_poses"]) == 0
    printed = capsys.readouterr().out
    assert "verdict: fly again" in printed
    out = Path("runs/survey-slope")
    assert str(out / "survey.html") in printed
    result = json.loads((out / "result.json").read_text())
    assert result["pose_source"]["verdict"].startswith("fly again")
    assert result["pose_source"]["computed_in_this_run"]
    assert {item.name for item in out.iterdir()} >= {"survey.html", "survey.toml", "recording.rrd", "cameras"}
    assert main(["survey", str(out / "survey.toml"), "--out", "again", "--store", "runs/store"]) == 0
    again = json.loads(Path("again/result.json").read_text())
    assert again["keys"] == result["keys"], "the written config means the same survey"
    assert not again["pose_source"]["computed_in_this_run"]


def test_a_stage_of_another_kind_is_refused(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["survey", str(photographs), "--pose-source", "standin_solver"]) == 2
    assert "is a solver, not a pose_source" in capsys.readouterr().err


def test_a_missing_folder_is_an_input_error(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["survey", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err
