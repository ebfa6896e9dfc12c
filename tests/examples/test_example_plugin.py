"""The example plugin, installed from its folder as an outsider would, passes the kit in a process of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "slideframe-mpm-flip"


def test_example_installs_and_conforms(tmp_path):
    # a copy, so that building leaves nothing in the repository
    source, site = tmp_path / "source", tmp_path / "site"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("__pycache__"))
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--no-index", "--target", str(site), str(source)], check=True)
    # from an empty folder: nothing but the installed distribution can be found
    command = [sys.executable, "-m", "pytest", "-q", "--import-mode=importlib", str(source / "tests")]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
    assert "skipped" not in done.stdout
