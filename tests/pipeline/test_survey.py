"""`slideframe survey` with a stand-in pose source, in this process."""

import json
import tomllib
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


def test_options_have_flags_as_run_has_them(photographs: Path) -> None:
    command = ["survey", str(photographs), "--pose-source", "standin_poses"]
    assert main([*command, "--seed", "7", "--plugins.standin-poses.height", "45"]) == 0
    resolved = tomllib.loads(Path("runs/survey-slope/survey.toml").read_text())
    assert resolved["seed"] == 7
    assert resolved["plugins"]["standin_poses"]["height"] == 45.0
    places = Path("runs/survey-slope/cameras/positions.csv").read_text().splitlines()
    assert float(places[1].split(",")[3]) == pytest.approx(345.0)


def test_a_stage_of_another_kind_is_refused(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["survey", str(photographs), "--pose-source", "standin_solver"]) == 2
    assert "is a solver, not a pose_source" in capsys.readouterr().err


def test_a_missing_folder_is_an_input_error(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["survey", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_positions_in_a_coordinate_system(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyproj")
    command = ["survey", str(photographs), "--pose-source", "standin_poses", "--epsg", "32632", "--geoid-offset", "49"]
    assert main(command) == 0
    assert "positions in EPSG:32632" in capsys.readouterr().out
    header, first, *_ = Path("runs/survey-slope/cameras/positions_epsg32632.csv").read_text().splitlines()
    assert header.startswith("name,easting,northing,orthometric_height,")
    assert 340_000 < float(first.split(",")[1]) < 345_000, "7 degrees east is 157 km west of the zone's meridian"


@pytest.mark.parametrize(
    ("flags", "what"),
    [
        (["--epsg", "4326"], "has no eastings"),
        (["--epsg", "99999"], "doesn't know EPSG:99999"),
        (["--geoid-offset", "1"], "give --epsg too"),
        (["--epsg", "2326", "--geoid-offset", "1", "--geoid-grid", "a.tif"], "not both"),
    ],
)
def test_heights_and_systems_are_checked_first(
    photographs: Path, capsys: pytest.CaptureFixture[str], flags: list[str], what: str
) -> None:
    pytest.importorskip("pyproj")
    assert main(["survey", str(photographs), "--pose-source", "standin_poses", *flags]) == 2
    assert what in capsys.readouterr().err
    assert not Path("runs").exists()
