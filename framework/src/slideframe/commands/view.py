"""`slideframe view RUN`: the recording in the rerun viewer."""

import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
from urllib.parse import urlencode

import tyro

from slideframe.errors import InputError, MissingDependency
from slideframe.run_folder import RECORDING

EVERY_MACHINE = "0.0.0.0"  # what the user may ask for


@dataclass(frozen=True)
class ViewOptions:
    """Open a run's recording in the rerun viewer."""

    run: Annotated[Path, tyro.conf.Positional]
    """A run folder, or a .rrd file."""
    web: bool = False
    """Serve it to a browser instead."""
    address: str = "127.0.0.1"
    """Of `--web`: who may look at it; 0.0.0.0 lets any machine that reaches this one."""
    port: int = 9090
    """Of `--web`: where the page is; the recording comes through the next one."""


def main(arguments: Sequence[str]) -> int:
    """Start the viewer and wait for it."""
    options = tyro.cli(ViewOptions, args=list(arguments), prog="slideframe view")
    recording = options.run if options.run.suffix == ".rrd" else options.run / RECORDING
    if not recording.is_file():
        raise InputError("there is no recording", where=str(recording), cure="name the folder of a finished run")
    command = [sys.executable, "-m", "rerun", str(recording), "--bind", options.address]
    if options.web:
        page, data = options.port, options.port + 1
        _require_free(options.address, page, data)
        command += ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]
        print(f"open {_link(options.address, page, data)}\nCtrl-C ends it", flush=True)
    else:
        _require_display()
    try:
        # the viewer's own log has a line for everything it does
        return subprocess.call(command, env={"RUST_LOG": "warn", **os.environ})
    except KeyboardInterrupt:  # how one stops serving
        return 0


def _link(address: str, page: int, data: int) -> str:
    """Return what to open in a browser."""
    host = socket.gethostname() if address == EVERY_MACHINE else address
    return f"http://{host}:{page}/?" + urlencode({"url": f"rerun+http://{host}:{data}/proxy"})


def _require_free(address: str, *ports: int) -> None:
    """Raise InputError where the address is not this machine's, or a port of it is taken."""
    for port in ports:
        with closing(socket.socket()) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((address, port))
            except (OSError, OverflowError) as error:
                raise InputError(
                    f"nothing can be served at port {port}: {error}",
                    where=f"--address {address} --port {ports[0]}",
                    cure="name an address of this machine, and a port that is free like the one after it",
                ) from error


def _require_display() -> None:
    """Raise MissingDependency on a Linux machine without a screen."""
    named = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in named):
        raise MissingDependency(
            "the viewer needs a display, and there is none",
            where=" or ".join(named[:2]),
            cure="serve the recording to a browser with --web, or copy it to a machine with a screen",
        )
