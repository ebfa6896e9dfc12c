"""`slideframe run` as its users meet it: in a process of its own, with quick stand-in stages."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CONFIG = """
[site]
photographs = "photographs"
[region]
x_min = 0.0
x_max = 9.0
y_min = 0.0
y_max = 9.0
z_min = -5.0
[material]
friction_angle = 22
density = 2000
youngs_modulus = 5e7
poisson_ratio = 0.3
[simulation]
duration = 0.4
grid_spacing = 2.0
[view]
width = 32
height = 32
[stages]
pose_source = "standin_poses"
reconstructor = "standin_splats"
volume_filler = "standin_filler"
solver = "standin_solver"
renderer = "standin_renderer"
"""
ALL = ["standin_poses", "standin_splats", "standin_filler", "standin_solver", "standin_renderer"]


class Workplace:
    """A folder with photographs and a config, and the command line in it."""

    def __init__(self, folder: Path, site: Path) -> None:
        self.folder = folder
        self.calls_file = folder / "calls"
        paths = [str(site), os.environ.get("PYTHONPATH", "")]
        self.environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
            "SLIDEFRAME_TEST_CALLS": str(self.calls_file),
        }
        (folder / "photographs").mkdir(parents=True)
        for index in range(3):
            pixels = np.full((30, 40, 3), 60 * index, np.uint8)
            Image.fromarray(pixels).save(folder / "photographs" / f"{index}.jpg")
        (folder / "case.toml").write_text(CONFIG)

    def command(self, *arguments: str) -> list[str]:
        return [sys.executable, "-m", "slideframe.cli", *arguments]

    def slideframe(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        self.calls_file.write_text("")
        return subprocess.run(
            self.command(*arguments), cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=120
        )

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        done = self.slideframe("run", "case.toml", *arguments)
        assert done.returncode == 0, done.stderr
        return done

    @property
    def calls(self) -> list[str]:
        return self.calls_file.read_text().split()

    def result(self, run: str = "case-standin_solver") -> dict:
        return json.loads((self.folder / "runs" / run / "result.json").read_text())

    def start_and_signal(self, when: str, number: int, *arguments: str) -> int:
        """Start a run, send it a signal one second after stage `when` has begun, and return its exit code."""
        self.calls_file.write_text("")
        process = subprocess.Popen(
            self.command("run", "case.toml", *arguments),
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # as from a terminal: a test runner started in the background may itself ignore Ctrl-C
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        deadline = time.monotonic() + 60
        while when not in self.calls and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(1.0)
        process.send_signal(number)
        return process.wait(timeout=60)


@pytest.fixture
def workplace(tmp_path: Path, standins: Path) -> Workplace:
    return Workplace(tmp_path / "work", standins)


def test_a_run_leaves_what_people_need(workplace):
    workplace.run()
    assert workplace.calls == ALL
    folder = workplace.folder / "runs" / "case-standin_solver"
    assert {item.name for item in folder.iterdir()} >= {
        "run.toml", "result.json", "log.jsonl", "film.mp4", "recording.rrd", "splats.ply", "cameras", "particles",
    }  # fmt: skip
    result = workplace.result()
    assert result["pose_source"]["reprojection_error_px"] == 0.5
    assert result["reconstructor"]["held_out_psnr_db"] == 30.0
    # free fall for 0.4 s
    assert result["solver"]["final_mean_displacement_m"] == pytest.approx(0.5 * 9.81 * 0.4**2, rel=1e-5)
    for kind in ("pose_source", "reconstructor", "volume_filler", "solver", "renderer"):
        assert result[kind]["wall_seconds"] >= 0
        assert result[kind]["peak_memory_mib"] > 1
    assert (folder / "particles" / "000010" / "positions.npy").is_file()


def test_a_second_run_computes_nothing_and_another_solver_only_from_itself_on(workplace):
    workplace.run()
    assert "nothing to do" in workplace.run().stdout
    assert workplace.calls == []
    workplace.run("--solver", "other_solver")
    assert workplace.calls == ["other_solver", "standin_renderer"]
    assert not workplace.result("case-other_solver")["reconstructor"]["computed_in_this_run"]


def test_a_changed_option_recomputes_from_its_stage_on(workplace):
    workplace.run()
    workplace.run("--simulation.gravity", "0", "0", "-5")
    assert workplace.calls == ["standin_solver", "standin_renderer"]
    workplace.run("--set", "plugins.standin_splats.size=0.3")
    # the filling follows from the centres alone, which are the same: the solver has nothing to do
    assert workplace.calls == ["standin_splats", "standin_filler", "standin_renderer"]
    workplace.run("--view.azimuth", "10")
    assert workplace.calls == ["standin_renderer"]


def test_a_changed_file_that_an_option_names_is_noticed(workplace):
    notes = workplace.folder / "elsewhere" / "notes.txt"
    notes.parent.mkdir()
    notes.write_text("one")
    config = workplace.folder / "elsewhere" / "case.toml"
    text = CONFIG.replace('"photographs"', '"../photographs"')
    config.write_text(text + '[plugins.standin_splats]\nnotes = "notes.txt"\n')
    command = ("run", "elsewhere/case.toml", "--until", "reconstructor")
    assert workplace.slideframe(*command).returncode == 0
    assert workplace.calls == ["standin_poses", "standin_splats"]
    workplace.slideframe(*command)
    assert workplace.calls == []
    notes.write_text("two")
    workplace.slideframe(*command)
    assert workplace.calls == ["standin_splats"]


def test_the_same_content_from_other_options_is_not_worked_on_again(workplace):
    workplace.run()
    workplace.run("--plugins.standin-solver.seconds", "0.001")
    assert workplace.calls == ["standin_solver"]


def test_a_result_that_comes_out_different_when_made_again_takes_later_results_with_it(workplace):
    workplace.run()
    stored = next((workplace.folder / "runs" / "store").glob("reconstructor-*"))
    shutil.rmtree(stored)
    workplace.environment["SLIDEFRAME_TEST_SHIFT"] = "0.25"
    workplace.run()
    assert workplace.calls == ALL[1:]


def test_a_changed_photograph_is_noticed(workplace):
    workplace.run()
    Image.fromarray(np.full((30, 40, 3), 9, np.uint8)).save(workplace.folder / "photographs" / "0.jpg")
    workplace.run()
    # the stand-ins make the same filling of any photographs, so the motion stays; the film may show the survey
    assert workplace.calls == ["standin_poses", "standin_splats", "standin_filler", "standin_renderer"]


def test_dry_run_tells_and_computes_nothing(workplace):
    lines = workplace.run("--dry-run").stdout.splitlines()
    assert [line.split()[0] for line in lines] == [
        "pose_source", "reconstructor", "volume_filler", "solver", "renderer",
    ]  # fmt: skip
    assert all("to do" in line for line in lines)
    assert workplace.calls == []
    assert not (workplace.folder / "runs").exists()


def test_until_stops_after_a_stage(workplace):
    workplace.run("--until", "reconstructor")
    assert workplace.calls == ["standin_poses", "standin_splats"]
    assert "solver" not in workplace.result()
    workplace.run()
    assert workplace.calls == ["standin_filler", "standin_solver", "standin_renderer"]


@pytest.mark.parametrize(
    ("stage", "slow"),
    [
        ("standin_splats", "plugins.standin_splats.seconds=0.8"),
        ("standin_solver", "plugins.standin_solver.seconds=0.3"),
    ],
)
def test_a_killed_run_goes_on_and_ends_as_an_unbroken_one(workplace, stage, slow):
    assert workplace.start_and_signal(stage, signal.SIGKILL, "--set", slow) == -signal.SIGKILL
    assert not (workplace.folder / "runs" / "case-standin_solver" / "result.json").exists()
    workplace.run("--set", slow)
    assert workplace.calls[0] == stage
    broken = workplace.folder / "runs" / "case-standin_solver"
    shutil.copytree(broken, workplace.folder / "broken")
    workplace.run("--set", slow, "--store", "fresh-store", "--out", "runs/unbroken")
    assert workplace.calls == ALL
    unbroken = workplace.folder / "runs" / "unbroken"
    for name in ("positions.npy", "velocities.npy"):
        same = [(folder / "particles" / "000010" / name).read_bytes() for folder in (broken, unbroken)]
        assert same[0] == same[1]
    assert (broken / "film.mp4").read_bytes() == (unbroken / "film.mp4").read_bytes()


def test_a_killed_motion_goes_on_after_its_last_frame_where_the_solver_can(workplace):
    can = ("--set", "plugins.standin_solver.resumes=true", "--set", "plugins.standin_solver.seconds=0.3")
    assert workplace.start_and_signal("frame-1", signal.SIGKILL, *can) == -signal.SIGKILL
    before = set(workplace.calls)
    workplace.run(*can)
    after = [call for call in workplace.calls if call.startswith("frame-")]
    # the last frame that was begun may not have been stored; all frames but that are computed once
    assert after[0] in (max(before & {f"frame-{index}" for index in range(11)}), f"frame-{11 - len(after)}")
    assert len(after) < 11
    assert workplace.result()["solver"]["resumed_from_item"] == 11 - len(after)
    broken = workplace.folder / "runs" / "case-standin_solver"
    contents = [json.loads((broken / "particles" / "manifest.json").read_text())["content"]]
    shutil.copytree(broken, workplace.folder / "broken")
    workplace.run(*can, "--store", "fresh-store", "--out", "runs/unbroken")
    unbroken = workplace.folder / "runs" / "unbroken"
    contents.append(json.loads((unbroken / "particles" / "manifest.json").read_text())["content"])
    assert contents[0] == contents[1]
    assert "resumed_from_item" not in workplace.result("unbroken")["solver"]


def test_a_killed_simulation_goes_on_from_its_checkpoint_to_the_same_bits(workplace):
    """With a real solver: SIGKILL once some frames are stored, then the same command again."""
    case = ["--solver", "mpm_warp", "--until", "solver", "--set", "simulation.duration=4.0"]
    case += ["--set", "plugins.mpm_warp.checkpoint_every=3"]
    process = subprocess.Popen(
        workplace.command("run", "case.toml", *case, "--out", "runs/case"), cwd=workplace.folder,
        env=workplace.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    deadline = time.monotonic() + 90
    while not list(workplace.folder.glob("runs/store/*.partial/000007")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    workplace.run(*case, "--out", "runs/case")
    resumed = workplace.result("case")["solver"]["resumed_from_item"]
    assert resumed >= 7
    assert resumed % 3 == 1
    broken = json.loads((workplace.folder / "runs" / "case" / "particles" / "manifest.json").read_text())
    workplace.run(*case, "--store", "fresh-store", "--out", "runs/unbroken")
    unbroken = json.loads((workplace.folder / "runs" / "unbroken" / "particles" / "manifest.json").read_text())
    assert "resumed_from_item" not in unbroken["figures"]
    assert broken["figures"]["substeps"] == unbroken["figures"]["substeps"]
    assert broken["content"] == unbroken["content"]


def test_compact_frames_make_the_same_film_within_the_stated_error(workplace):
    workplace.run()
    whole = np.load(workplace.folder / "runs" / "case-standin_solver" / "particles" / "000010" / "positions.npy")
    workplace.run("--set", "simulation.stored_frames=compact", "--out", "runs/compact")
    assert workplace.calls == ["standin_solver", "standin_renderer"]
    frames = workplace.folder / "runs" / "compact" / "particles"
    assert not (frames / "000010" / "positions.npy").exists()
    low, step = np.load(frames / "000010" / "positions.box.npy")
    error = np.abs(low + step * np.load(frames / "000010" / "positions.fixed.npy") - whole).max()
    assert error <= workplace.result("compact")["solver"]["stored_position_error_m"] * 1.001 + 1e-6


def test_ctrl_c_leaves_a_resumable_run_and_exits_130(workplace):
    slow = ("--set", "plugins.standin_solver.seconds=0.3")
    assert workplace.start_and_signal("standin_solver", signal.SIGINT, *slow) == 130
    workplace.run(*slow)
    assert workplace.calls == ["standin_solver", "standin_renderer"]


def test_a_failing_stage_is_named_and_earlier_results_are_kept(workplace):
    done = workplace.slideframe("run", "case.toml", "--set", "plugins.standin_solver.fail_at=4")
    assert done.returncode == 4
    assert "'standin_solver' of distribution standins 1.0 stopped: ZeroDivisionError: planted" in done.stderr
    log = (workplace.folder / "runs" / "case-standin_solver" / "log.jsonl").read_text()
    assert "Traceback" in log
    workplace.run()
    assert workplace.calls == ["standin_solver", "standin_renderer"]


def test_not_a_number_in_a_product_is_told_with_field_and_place(workplace):
    done = workplace.slideframe("run", "case.toml", "--set", "plugins.standin_splats.give_nan=true")
    assert done.returncode == 4
    assert "centers" in done.stderr
    assert "element (7, 2) is nan" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--set", "material.frction_angle=3"], 2, "did you mean 'friction_angle'"),
        (["--set", "simulation.duration=long"], 2, "simulation.duration: Input should be a valid number"),
        (["--set", "plugins.standin_solver.secnds=1"], 2, "did you mean 'seconds'"),
        (["--solver", "mpm_wrap"], 2, "did you mean 'mpm_warp'"),
        (["--solver", "standin_filler"], 2, "'standin_filler' is a volume_filler, not a solver"),
        (["--device", "tpu"], 2, "unknown device 'tpu'"),
        (["--region.x-min", "99"], 2, "x_min must be less than x_max"),
        (["--regoin.x-min", "9"], 2, "--region.x-min"),
        (["--set", "site.photographs=nowhere"], 2, "no photographs"),
        (["--set", "reference_ground.path=nowhere.asc"], 2, "where: [reference_ground] /"),
        (["--set", "plugins.standin_solvr.seconds=1"], 2, "did you mean 'standin_solver'"),
        (["--view.background", "200", "220", "255"], 2, "less than or equal to 1"),
        (["--region.x-min", "1", "--solver", "other_solver", "nowhere.toml"], 2, "nrecognized"),
    ],
)
def test_bad_input_is_told_before_anything_computes(workplace, arguments, code, message):
    done = workplace.slideframe("run", "case.toml", *arguments)
    assert done.returncode == code, done.stderr
    assert message in done.stderr
    assert workplace.calls == []


def test_a_region_outside_the_survey_is_told_before_the_splats(workplace):
    done = workplace.slideframe("run", "case.toml", "--region.x-min", "100", "--region.x-max", "120")
    assert done.returncode == 2
    assert "the survey covers x 0.0 to 9.0" in done.stderr
    assert workplace.calls == ["standin_poses"]


def test_the_surface_is_compared_with_a_reference_ground(workplace):
    """The stand-ins' ground is level at 0 where the region's south-western half is, the reference 0.25 m above."""
    workplace.run()
    path = workplace.folder / "lidar.asc"
    path.write_text("ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 3\n" + "0.25 0.25 0.25\n" * 3)
    workplace.run("--set", f"reference_ground.path={path}")
    assert workplace.calls == []  # it changes no result, and is in the report all the same
    figures = workplace.result()["volume_filler"]
    assert figures["reference_bias_m"] == pytest.approx(-0.25)
    assert figures["reference_rmse_m"] == pytest.approx(0.25)
    assert figures["reference_covered_share"] == pytest.approx(0.5, abs=0.01)


def test_a_reference_ground_elsewhere_is_told_before_the_splats(workplace):
    path = workplace.folder / "lidar.asc"
    path.write_text("ncols 2\nnrows 1\nxllcorner 50\nyllcorner 50\ncellsize 3\n1 1\n")
    done = workplace.slideframe("run", "case.toml", "--set", f"reference_ground.path={path}")
    assert done.returncode == 2
    assert "no value over the region" in done.stderr
    assert "[reference_ground]" in done.stderr
    assert workplace.calls == ["standin_poses"]


def test_a_store_that_cannot_be_written_is_told_before_anything_computes(workplace):
    (workplace.folder / "blocked").write_text("in the way")
    done = workplace.slideframe("run", "case.toml", "--store", "blocked/store")
    assert done.returncode == 4
    assert "results can't be written" in done.stderr
    assert workplace.calls == []


def test_two_runs_never_share_a_folder(workplace):
    slow = ("--set", "plugins.standin_solver.seconds=0.5")
    workplace.calls_file.write_text("")
    first = subprocess.Popen(
        workplace.command("run", "case.toml", *slow),
        cwd=workplace.folder, env=workplace.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while "standin_solver" not in workplace.calls:
        time.sleep(0.05)
    second = subprocess.run(
        workplace.command("run", "case.toml", *slow),
        cwd=workplace.folder, env=workplace.environment, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert second.returncode == 4
    assert "another run is writing" in second.stderr
    assert first.wait(timeout=60) == 0


def test_the_resolved_config_runs_the_same(workplace):
    workplace.run("--material.density", "1900")
    again = workplace.slideframe(
        "run", "runs/case-standin_solver/run.toml", "--out", "runs/again", "--store", "runs/store"
    )
    assert again.returncode == 0, again.stderr
    assert workplace.calls == []
    assert workplace.result("again")["keys"] == workplace.result()["keys"]


def test_a_config_behind_flags_of_single_keys_is_not_overlooked(workplace):
    done = workplace.slideframe("run", "--material.density", "1900", "case.toml")
    assert done.returncode == 2
    assert "CONFIG" in done.stderr
    assert workplace.calls == []


def test_runs_that_share_a_store_take_turns_at_one_result(workplace):
    slow = ("--set", "plugins.standin_solver.seconds=0.3")
    workplace.calls_file.write_text("")
    first = subprocess.Popen(
        workplace.command("run", "case.toml", *slow, "--out", "runs/a"),
        cwd=workplace.folder, env=workplace.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while "standin_solver" not in workplace.calls:
        time.sleep(0.05)
    second = subprocess.run(
        workplace.command("run", "case.toml", *slow, "--out", "runs/b"),
        cwd=workplace.folder, env=workplace.environment, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert first.wait(timeout=60) == 0
    assert second.returncode == 0, second.stderr
    assert workplace.calls.count("standin_solver") == 1
    frames = sorted(item.name for item in (workplace.folder / "runs" / "b" / "particles").glob("0*"))
    assert frames == [f"{index:06d}" for index in range(11)]
    assert not list((workplace.folder / "runs" / "store").glob("*.lock"))


def test_outputs_of_another_result_do_not_stay(workplace):
    workplace.run()
    workplace.run("--region.x-max", "8.5", "--until", "reconstructor")
    left = {item.name for item in (workplace.folder / "runs" / "case-standin_solver").iterdir()}
    assert not left & {"film.mp4", "particles"}
    assert left >= {"splats.ply", "cameras", "recording.rrd", "result.json"}


def test_a_solver_that_stops_early_is_told_and_not_stored(workplace):
    done = workplace.slideframe("run", "case.toml", "--set", "plugins.standin_solver.leave_out=2")
    assert done.returncode == 3
    assert "gave 9 items of 11" in done.stderr
    assert not list((workplace.folder / "runs" / "store").glob("solver-*[!l]/manifest.json"))


def test_a_relative_folder_of_photographs_means_the_same_in_the_resolved_config(workplace):
    shutil.copytree(workplace.folder / "photographs", workplace.folder / "others")
    workplace.run("--site.photographs", "others")
    again = workplace.slideframe("run", "runs/case-standin_solver/run.toml", "--out", "runs/again")
    assert again.returncode == 0, again.stderr
    assert workplace.calls == []
