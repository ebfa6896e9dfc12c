"""The splats as a viewer in a web browser shows them, from a camera of the survey, beside photograph and ours.

    npm install --prefix FOLDER three @mkkellogg/gaussian-splats-3d
    python benchmarks/browser_viewer.py FOLDER SURVEY_RESULT SPLATS_RESULT PICTURE.jpg [--photograph N]

The results are stored ones, as for `independent_viewer.py`. A Chromium without a window (`--browser` names it) opens a
page with the viewer and the PLY file that a run writes, draws it in software, and sends the picture back. The picture
has the photograph, `rasterize()` and the browser's picture side by side; the mean differences are printed.
"""

import argparse
import base64
import functools
import io
import json
import os
import signal
import subprocess
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
from independent_viewer import BACKGROUND, compare
from PIL import Image

from slideframe_gs_torch.views import TrainingView

SECONDS = 240
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--disable-dev-shm-usage", "--hide-scrollbars",
)  # fmt: skip
PAGE = """<!doctype html><body style="margin:0"><script type="importmap">{"imports": {
"three": "/node_modules/three/build/three.module.js",
"viewer": "/node_modules/@mkkellogg/gaussian-splats-3d/build/gaussian-splats-3d.module.js"}}</script>
<script type="module">
import * as THREE from 'three';
import { Viewer } from 'viewer';
const view = VIEW;
const say = (path, body) => fetch(path, { method: 'POST', body });
try {
  const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
  renderer.setSize(view.width, view.height);
  renderer.setClearColor(new THREE.Color().setRGB(...view.background, THREE.SRGBColorSpace), 1);
  document.body.appendChild(renderer.domElement);
  const camera = new THREE.PerspectiveCamera();
  camera.updateProjectionMatrix = () => {};
  camera.projectionMatrix.set(...view.projection);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  new THREE.Matrix4().set(...view.pose).decompose(camera.position, camera.quaternion, camera.scale);
  camera.updateMatrixWorld();
  const viewer = new Viewer({
    renderer, camera, selfDrivenMode: false, useBuiltInControls: false, sharedMemoryForWorkers: false,
    ignoreDevicePixelRatio: true, sphericalHarmonicsDegree: 1, sceneRevealMode: 2,
  });
  await viewer.addSplatScene('splats.ply', { splatAlphaRemovalThreshold: 1, showLoadingUI: false });
  let calm = 0;
  while (calm < 3) {  // the splats are sorted elsewhere, in turns: all must be, and then drawn
    viewer.update();
    viewer.render();
    await new Promise((done) => setTimeout(done, 500));
    const all = viewer.splatRenderCount === viewer.splatMesh.getSplatCount();
    calm = viewer.sortRunning || !all ? 0 : calm + 1;
  }
  await say('picture', renderer.domElement.toDataURL('image/png').split(',')[1]);
} catch (error) {
  await say('error', String(error.stack || error));
}
</script></body>"""


def page_of(view: TrainingView) -> str:
    """Return the page with the view's camera in the viewer's convention: x right, y up, z back."""
    camera, near, far = view.camera, 0.1, 10_000.0
    pose = np.vstack([view.world_from_camera, [0, 0, 0, 1]]) @ np.diag([1.0, -1, -1, 1])
    projection = [
        [2 * camera.focal_x / camera.width, 0, 1 - 2 * camera.principal_x / camera.width, 0],
        [0, 2 * camera.focal_y / camera.height, 2 * camera.principal_y / camera.height - 1, 0],
        [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)],
        [0, 0, -1, 0],
    ]
    values = {
        "width": camera.width, "height": camera.height, "background": BACKGROUND,
        "pose": pose.ravel().tolist(), "projection": [number for row in projection for number in row],
    }  # fmt: skip
    return PAGE.replace("VIEW", json.dumps(values))


class Site(SimpleHTTPRequestHandler):
    """Serves a folder, and hears what the page has to say."""

    def __init__(self, *arguments, heard: dict[str, bytes], told: threading.Event, **options) -> None:
        self.heard, self.told = heard, told
        super().__init__(*arguments, **options)

    def do_POST(self) -> None:
        self.heard[self.path] = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self.told.set()

    def log_message(self, *_arguments) -> None:
        """Keep quiet."""


def seen_by_browser(folder: Path, browser: str) -> Image.Image:
    """Return the picture that the folder's page sends."""
    heard: dict[str, bytes] = {}
    told = threading.Event()
    site = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Site, directory=folder, heard=heard, told=told))
    threading.Thread(target=site.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{site.server_port}/index.html"
    command = [browser, *FLAGS, f"--user-data-dir={folder / 'profile'}", "--remote-debugging-port=0", address]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        told.wait(SECONDS)
    finally:
        os.killpg(process.pid, signal.SIGKILL)  # `chromium` may be a script that starts it, and it starts others
        site.shutdown()
    if "/picture" not in heard:
        raise SystemExit(f"the page sent no picture: {heard.get('/error', b'nothing within the time').decode()}")
    return Image.open(io.BytesIO(base64.b64decode(heard["/picture"]))).convert("RGB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", type=Path, help="the folder that npm has installed the viewer in")
    parser.add_argument("--browser", default="chromium")

    def seen(folder: Path, view: TrainingView, arguments: argparse.Namespace) -> Image.Image:
        (folder / "index.html").write_text(page_of(view))
        (folder / "node_modules").symlink_to((arguments.packages / "node_modules").resolve())
        return seen_by_browser(folder, arguments.browser)

    compare(parser, seen)


if __name__ == "__main__":
    main()
