"""`slideframe compare` on run folders as a run leaves them."""

import json

import numpy as np
import pytest

from slideframe.cli import main
from slideframe.config import RunConfig, validate, write_toml
from slideframe.reference.solver import ReferenceSolver
from slideframe.store import Store
from slideframe.testing.evidence import fresh_context
from slideframe.testing.solver_scenes import block_filling, sand_problem
from slideframe.verification.agreement import compare, thickness

PROBLEM = sand_problem(duration=0.3)
FILLING = block_filling((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    return list(ReferenceSolver().solve(FILLING, PROBLEM, fresh_context(tmp_path_factory.mktemp("scratch"))))


@pytest.fixture
def run(tmp_path, frames):
    """Lay out a run folder as `slideframe run` does."""

    def lay_out(name, moved=0.0, filling=FILLING, filling_key="a", solver="mpm_warp", **changes):
        content = {
            "site": {"photographs": "photographs"},
            "region": {"x_min": 0, "x_max": 4, "y_min": 0, "y_max": 1, "z_min": 0},
            "stages": {"solver": solver},
            **json.loads(PROBLEM.model_dump_json(exclude={"georeference"})),  # a run has it from its survey
        }
        for key, value in changes.items():
            table, _, last = key.partition("__")
            content[table][last] = value
        store = Store(tmp_path / "store")
        store.open()
        keys = {"volume_filler": filling_key, "solver": name}
        if not store.entry("volume_filler", filling_key).is_whole:
            store.entry("volume_filler", filling_key).write(filling, dict)
        drift = np.array([moved, 0, 0], np.float32)
        altered = (frame.model_copy(update={"positions": frame.positions + frame.time * drift}) for frame in frames)
        store.entry("solver", name).write_stream(altered, dict)
        folder = tmp_path / name
        folder.mkdir()
        write_toml(validate(RunConfig, content, name), folder / "run.toml")
        (folder / "result.json").write_text(json.dumps({"keys": keys}))
        (folder / "particles").symlink_to(store.entry("solver", name).folder)
        return str(folder)

    return lay_out


def test_a_run_agrees_with_itself_by_another_solver(run, capsys):
    assert main(["compare", run("one"), run("two", solver="mpm_taichi", simulation__precision="float64")]) == 0
    printed = capsys.readouterr().out
    assert "the runs agree within 1.00%" in printed
    assert "mpm_taichi, float64" in printed
    assert printed.count("0.00%") >= 7


def test_a_drift_of_a_tenth_of_the_run_out_is_found(run, frames, capsys):
    assert main(["compare", run("one"), run("two", moved=0.3)]) == 4
    assert "DISAGREE" in capsys.readouterr().out


def test_a_wider_tolerance_forgives(run):
    assert main(["compare", run("one"), run("two", moved=0.003), "--tolerance", "0.5"]) == 0


def test_json_holds_figures_and_energies(run, capsys):
    main(["compare", run("one"), run("two"), "--json"])
    content = json.loads(capsys.readouterr().out)
    assert {"run-out", "centre of mass, x"} <= {figure["name"] for figure in content["figures"]}
    assert np.shape(content["kinetic_energy_j"]) == (4, 2)


def test_different_problems_are_refused_with_their_keys(run, capsys):
    other = run("two", material__friction_angle=35.0, simulation__duration=0.4)
    assert main(["compare", run("one"), other]) == 2
    told = capsys.readouterr().err
    assert "material.friction_angle: 30.0 in the first, 35.0 in the second" in told
    assert "simulation.duration" in told
    assert "solver" not in told.splitlines()[1]


def test_different_fillings_are_refused_with_what_made_them(run, capsys):
    other = block_filling((0.0, 0.0, 0.0), (1.0, 1.0, 0.5))
    assert main(["compare", run("one"), run("two", filling=other, filling_key="b", region__z_min=-1.0)]) == 2
    assert "region.z_min" in capsys.readouterr().err


def test_a_folder_without_a_motion_is_refused(tmp_path, capsys):
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "no finished run" in capsys.readouterr().err


def test_energies_are_those_of_the_frames(frames):
    result = compare(frames, frames, FILLING, PROBLEM)
    mass = 2000 * FILLING.particle_volumes.astype(np.float64)
    expected = [0.5 * mass @ (frame.velocities.astype(np.float64) ** 2).sum(axis=1) for frame in frames]
    np.testing.assert_allclose(result.kinetic[:, 0], expected)
    assert result.agrees(0.0)


def test_thickness_holds_all_volume(frames):
    raster = thickness(frames[0], FILLING, 0.25)
    assert raster.sum() * 0.5**2 == pytest.approx(FILLING.particle_volumes.sum(), rel=1e-6)
    assert raster.max() == pytest.approx(1.0, rel=0.3)
