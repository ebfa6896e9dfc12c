"""The whole path with the real plugins on a small demo survey, and what it leaves, read back as its users would."""

import ctypes
import io
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.formats.splat_ply import read_splat_ply

pytestmark = pytest.mark.slow

OPTIONS = [
    "--view.width", "320", "--view.height", "180",
    "--simulation.duration", "1.5", "--simulation.grid-spacing", "3", "--simulation.frame-rate", "10",
    "--plugins.gs-torch.iterations", "300",
    "--plugins.gs-torch.image-width", "240",
    "--plugins.gs-torch.splat-budget", "20000",
]  # fmt: skip
# 300 iterations at 240 px resemble the site; a picture of one mean colour reaches 14 dB
LEAST_PSNR_DB = 19.0
# RTK noise is 1 to 2 cm a photograph
MOST_CENTRE_RESIDUAL_M = 0.05
# between two float32 backends after a second and a half of flow: physics.md's ladder for long runs
AGREEMENT = 0.01


def slideframe(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "slideframe.cli", *arguments], cwd=folder, capture_output=True, text=True, timeout=600
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the small demo has been run with both solvers."""
    folder = tmp_path_factory.mktemp("demo")
    config = Path(__file__).parents[2] / "configs" / "demo.toml"
    assert slideframe(folder, "demo-survey", "runs/demo-survey", "--width", "480").returncode == 0
    (folder / "configs").mkdir()
    shutil.copy(config, folder / "configs" / "demo.toml")
    for solver in ("mpm_warp", "mpm_taichi"):
        done = slideframe(folder, "run", "configs/demo.toml", "--solver", solver, *OPTIONS)
        assert done.returncode == 0, done.stderr
    return folder / "runs"


def result(place: Path, run: str) -> dict:
    return json.loads((place / run / "result.json").read_text())


def test_figures_are_those_of_a_site(place):
    figures = result(place, "demo-mpm_warp")
    assert figures["pose_source"]["registered_photographs"] == 32
    assert figures["pose_source"]["reprojection_error_px"] < 0.6
    for axis in ("east", "north", "up"):
        assert figures["pose_source"][f"centre_residual_{axis}_m"] < MOST_CENTRE_RESIDUAL_M
    assert figures["reconstructor"]["held_out_psnr_db"] > LEAST_PSNR_DB
    assert abs(figures["volume_filler"]["volume_rescaling_percent"]) < 0.5
    # the true ground is the config's reference; 20 000 splats of a short training are 0.7 m apart
    assert figures["volume_filler"]["reference_covered_share"] > 0.9
    assert figures["volume_filler"]["reference_rmse_m"] < 1.0
    assert figures["solver"]["escaped_particles"] == 0
    assert figures["solver"]["final_potential_energy_j"] < 0
    assert figures["renderer"]["frames_per_second"] > 0


def test_the_second_solver_reuses_all_before_it_and_agrees(place):
    warp, taichi = result(place, "demo-mpm_warp"), result(place, "demo-mpm_taichi")
    for kind in ("pose_source", "reconstructor", "volume_filler"):
        assert not taichi[kind]["computed_in_this_run"]
        assert warp["keys"][kind] == taichi["keys"][kind]
    for figure in ("final_run_out_m", "final_mean_displacement_m", "final_potential_energy_j"):
        assert taichi["solver"][figure] == pytest.approx(warp["solver"][figure], rel=AGREEMENT)


def test_the_splats_open_elsewhere(place):
    splats = read_splat_ply(place / "demo-mpm_warp" / "splats.ply")
    assert len(splats) == result(place, "demo-mpm_warp")["reconstructor"]["splats"]


def test_the_film_begins_as_the_site_looks_and_the_mass_moves(place):
    av = pytest.importorskip("av")
    with av.open(str(place / "demo-mpm_warp" / "film.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in film.decode(video=0)]
    assert len(frames) == 16
    assert frames[0].shape == (180, 320, 3)
    assert frames[0].std() > 20  # a site, not a blank
    assert np.abs(frames[-1] - frames[0]).mean() > 2


def test_pictures_lie_beside_the_film(place):
    for name in ("contact_sheet.png", "before_after.png"):
        with Image.open(place / "demo-mpm_warp" / name) as picture:
            assert np.asarray(picture.convert("RGB")).std() > 20


def test_the_recording_is_sound_and_holds_every_product(place):
    recording = place / "demo-mpm_warp" / "recording.rrd"
    verified = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", str(recording)], capture_output=True)
    assert verified.returncode == 0, verified.stderr
    import rerun.chunk

    reader = rerun.chunk.RrdReader(str(recording))
    schema = reader.store().schema()
    entities = set(schema.entity_paths())
    assert entities >= {
        "/survey/points", "/reconstruction/splats", "/volume/surface", "/volume/by_depth", "/motion/splats",
        "/motion/particles", "/film", "/map/thickness", "/figures/energy/kinetic", "/figures/travel/front",
        "/figures/mass/moving", "/figures/volume/outside", "/report/result", "/report/config",
    }  # fmt: skip
    assert sum(entity.startswith("/survey/cameras/") for entity in entities) == 32
    assert sum(entity.startswith("/training/") for entity in entities) == 1
    assert reader.blueprints()
    assert recording.stat().st_size < 300e6


def vulkan_is_there() -> bool:
    """Whether the viewer can draw: without a loader and a driver it dies after it has started."""
    try:
        ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return False
    drivers = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    folders = (Path(root) / "vulkan" / "icd.d" for root in ("/usr/share", "/etc", "/usr/local/share"))
    return bool(drivers) or any(any(folder.glob("*.json")) for folder in folders)


# what the viewer would read is checked without it, by the test above
@pytest.mark.skipif(
    not vulkan_is_there(), reason="no Vulkan driver for the viewer: apt-get install mesa-vulkan-drivers libvulkan1"
)
def test_the_viewer_shows_it_without_complaint(place, monkeypatch):
    from rerun.experimental import ViewerClient

    binaries = Path(sys.executable).parent
    monkeypatch.setenv("PATH", f"{binaries}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("RERUN_ANALYTICS", "off")
    viewer = ViewerClient.spawn(headless=True, port=free_port(), hide_welcome_screen=True)
    try:
        viewer.open(str(place / "demo-mpm_warp" / "recording.rrd"))
        viewer.set_time("sim_time", duration=1.0)
        picture = wait_for_picture(viewer)
        state, logs = viewer.get_state(), viewer.get_logs()
    finally:
        viewer.quit()
    assert not [report for view in state.views for report in view.reports]
    assert not [entry for entry in logs if entry.level == "ERROR"]
    # the left half is the view of the moving splats: the site's colours, not the grid on black
    left = picture[:, : picture.shape[1] // 2].astype(float)
    assert (np.ptp(left, axis=2) > 25).mean() > 0.05


def wait_for_picture(viewer) -> np.ndarray:
    """Take pictures until two are alike: the first can show a viewer that is still loading."""
    deadline, before = time.monotonic() + 90, np.zeros(())
    while time.monotonic() < deadline:
        time.sleep(4)
        shot = None
        with suppress(TimeoutError):  # a viewer that still loads, on a busy machine
            shot = viewer.take_screenshot()
        if shot is None:
            continue
        picture = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))
        if (
            viewer.get_state().views
            and before.shape == picture.shape
            and np.abs(picture - before.astype(int)).mean() < 1
        ):
            return picture
        before = picture
    pytest.fail("the viewer did not settle within 90 s")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
