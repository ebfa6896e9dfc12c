"""What commands and plugins import, seen from a fresh interpreter."""

import json
import subprocess
import sys

import pytest

BACKENDS = {"torch", "warp", "taichi", "open3d", "pycolmap", "pyproj", "numba", "rerun", "av", "scipy", "gsply"}
PLUGINS = ("pose_rtk", "gs_torch", "gs_import", "render_gs", "fill_poisson", "mpm_warp", "mpm_taichi")


def imported_by(code: str) -> set[str]:
    program = f"{code}\nimport sys, json; print(); print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}


@pytest.mark.parametrize("command", ["--help", "plugins", "plugins --json"])
def test_help_and_listing_import_no_backend_and_not_even_numpy(command):
    modules = imported_by(f"from slideframe.cli import main; main({command.split()!r})")
    assert not modules & (BACKENDS | {"numpy"} | {f"slideframe_{name}" for name in PLUGINS})


def test_schema_imports_plugins_without_their_backends():
    modules = imported_by("from slideframe.cli import main; main(['schema'])")
    assert modules >= {f"slideframe_{name}" for name in PLUGINS}
    assert not modules & BACKENDS


def test_run_help_imports_no_backend():
    call = "try: main(['run', '--help'])\nexcept SystemExit as done: assert done.code == 0"
    modules = imported_by(f"from slideframe.cli import main\n{call}")
    assert not modules & BACKENDS


@pytest.mark.parametrize("name", PLUGINS)
def test_a_plugin_imports_without_its_backend(name):
    assert not imported_by(f"import slideframe_{name}") & BACKENDS
