"""`slideframe view RUN`: the recording in the rerun viewer."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from slideframe.errors import InputError
from slideframe.run_folder import RECORDING


@dataclass(frozen=True)
class ViewOptions:
    """Open a run's recording in the rerun viewer."""

    run: Annotated[Path, tyro.conf.Positional]
    """A run folder, or a .rrd file."""
    web: bool = False
    """Serve it to a browser instead."""
    address: str = "127.0.0.1"
    """Of `--web`: who may look at it; 0.0.0.0 lets any machine that reaches this one."""


def main(arguments: Sequence[str]) -> int:
    """Start the viewer and wait for it."""
    options = tyro.cli(ViewOptions, args=list(arguments), prog="slideframe view")
    recording = options.run if options.run.suffix == ".rrd" else options.run / RECORDING
    if not recording.is_file():
        raise InputError("there is no recording", where=str(recording), cure="name the folder of a finished run")
    serve = ["--serve-web", "--bind", options.address] if options.web else []
    try:
        return subprocess.call([sys.executable, "-m", "rerun", str(recording), *serve])
    except KeyboardInterrupt:  # how one stops serving
        return 0
