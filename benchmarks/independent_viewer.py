"""The splats as another renderer shows them: rerun's viewer, from a camera of the survey, beside photograph and ours.

    python benchmarks/independent_viewer.py SURVEY_RESULT SPLATS_RESULT PICTURE.jpg [--photograph N] [--photographs DIR]

The results are stored ones, `store/pose_source-<key>` and `store/reconstructor-<key>`. The viewer reads the PLY file
that a run writes, by its own importer, and draws without a display; it needs a Vulkan driver (mesa-vulkan-drivers). The
picture has the photograph, `rasterize()` and the viewer's picture side by side; the mean differences are printed.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient
from training import moved

from slideframe.device import Device
from slideframe.formats.splat_ply import write_splat_ply
from slideframe.products import SplatCloud, Survey
from slideframe.record.scene import pinhole
from slideframe.stages import Context
from slideframe.store import Entry
from slideframe_gs_torch.evaluation import draw_view
from slideframe_gs_torch.views import TrainingView, load_views

WIDTH = 640
BACKGROUND = (0.5, 0.5, 0.5)
# px around the view: what the viewer's own bars take at least
BARS = 110
SECONDS = 90


def scene(folder: Path, view: TrainingView) -> list[Path]:
    """Write what the viewer opens beside the PLY file: the camera to look through."""
    recording = rr.RecordingStream("independent viewer", recording_id="view")
    eye = rrb.EyeControls3D(tracking_entity="/camera")
    grey = [round(255 * level) for level in BACKGROUND]
    shown = rrb.Spatial3DView(origin="/", background=grey, eye_controls=eye, line_grid=rrb.LineGrid3D(visible=False))
    recording.save(folder / "view.rrd", default_blueprint=rrb.Blueprint(shown, collapse_panels=True))
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("camera", *pinhole(view.camera, view.world_from_camera, image_plane_distance=1e-3), static=True)
    recording.log_file_from_path(folder / "splats.ply", entity_path_prefix="scan", static=True)
    recording.flush()
    recording.disconnect()
    return [folder / "view.rrd"]


def seen_by_viewer(files: list[Path], folder: Path, view: TrainingView) -> Image.Image:
    """Return what the viewer shows of the camera's frame."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    size = f"{view.camera.width + BARS}x{view.camera.height + BARS}"
    command = [
        Path(sys.executable).with_name("rerun"),
        "--headless",
        "--window-size",
        size,
        "--port",
        str(port),
        *files,
    ]
    surroundings = os.environ | {"RERUN_ANALYTICS": "off"}
    viewer = subprocess.Popen(
        command, env=surroundings, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True
    )
    try:
        client = wait_for(lambda: ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy"))
        (shown,) = wait_for(lambda: client.get_state().views)
        time.sleep(10)  # its first pictures may show a file that is still being read
        wait_for(lambda: client.save_screenshot(str(folder / "shot.png"), view_id=shown.view_id) or True)
    finally:
        os.killpg(viewer.pid, signal.SIGKILL)  # `rerun` is a script that starts the viewer
    return framed(Image.open(folder / "shot.png").convert("RGB"), view)


def wait_for(attempt):
    """Return what an attempt gives once it gives something."""
    deadline = time.monotonic() + SECONDS
    while True:
        try:
            if found := attempt():
                return found
        except Exception:  # the client's errors while the viewer starts have no class of their own
            if time.monotonic() > deadline:
                raise
        time.sleep(2)


def framed(shot: Image.Image, view: TrainingView) -> Image.Image:
    """Cut the photograph's frame out: the viewer fits its height and centres it."""
    width = shot.height * view.camera.width / view.camera.height
    left = (shot.width - width) / 2
    return shot.crop((round(left), 0, round(left + width), shot.height)).resize((view.camera.width, view.camera.height))


def compare(parser: argparse.ArgumentParser, seen: Callable[..., Image.Image]) -> None:
    """Read what is compared, let `seen(folder, view, arguments)` draw it too, save the pictures and print."""
    parser.add_argument("survey", type=Path)
    parser.add_argument("splats", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--photograph", type=int, default=24, help="its place in the survey, from 0")
    parser.add_argument("--photographs", type=Path, help="their folder, where it is no longer that of the survey")
    arguments = parser.parse_args()
    survey = moved(Entry(arguments.survey).read(Survey), arguments.photographs)
    splats = Entry(arguments.splats).read(SplatCloud)
    folder = Path(tempfile.mkdtemp())
    (view,) = load_views(survey, [arguments.photograph], WIDTH, Context(device=Device(), scratch=folder))
    ours = draw_view(splats, view, BACKGROUND).permute(1, 2, 0).mul(255).round().byte().numpy()
    write_splat_ply(splats, folder / "splats.ply")
    theirs = np.asarray(seen(folder, view, arguments))
    photograph = view.pixels.permute(1, 2, 0).numpy()
    Image.fromarray(np.concatenate([photograph, ours, theirs], axis=1)).save(arguments.picture, quality=88)
    for name, one, other in (
        ("photograph and ours", photograph, ours),
        ("photograph and viewer's", photograph, theirs),
        ("ours and viewer's", ours, theirs),
    ):
        difference = one.astype(float) - other
        psnr = -10 * np.log10((difference**2).mean() / 255**2)
        print(f"{name}: {psnr:.2f} dB, mean {difference.mean():+.1f} grey levels")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    compare(parser, lambda folder, view, _arguments: seen_by_viewer(scene(folder, view), folder, view))


if __name__ == "__main__":
    main()
