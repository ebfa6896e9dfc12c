"""Fixtures for all tests: stand-in plugins that count as installed, and the team's shared data where it is."""

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

STANDINS = Path(__file__).parent / "pipeline" / "standins"
REPOSITORY = Path(__file__).parent.parent

# Tests never judge seconds: a busy machine is no fault of the law under test.
hypothesis.settings.register_profile("slideframe", deadline=None)
hypothesis.settings.load_profile("slideframe")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of shared data, read only."""
    folder = Path(os.environ.get("SLIDEFRAME_SHARED", REPOSITORY.parent / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no shared data at {folder}; set SLIDEFRAME_SHARED")
    return folder


def write_distribution(folder: Path, name: str, entry_points: dict[str, str], kind: str = "") -> None:
    """Make a distribution as installers leave it: a .dist-info with entry points."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    keywords = f"Keywords: slideframe-{kind}\n" if kind else ""
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{keywords}")
    lines = [f"{entry} = {module}" for entry, module in entry_points.items()]
    (info / "entry_points.txt").write_text("\n".join(["[slideframe]", *lines, ""]))


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Install a fake distribution for this test; returns its site folder."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))

    def installer(
        name: str, entry_points: dict[str, str], modules: dict[str, str] | None = None, kind: str = ""
    ) -> Path:
        write_distribution(site, name, entry_points, kind)
        for module, source in (modules or {}).items():
            (site / f"{module}.py").write_text(source)
        return site

    return installer


@pytest.fixture
def standins(install: Callable[..., Path]) -> Path:
    """Install the stand-in plugins; returns the site folder, for subprocesses."""
    site = install(
        "standins",
        {
            "standin_poses": "slideframe_standins.poses",
            "standin_splats": "slideframe_standins.splats",
            "standin_filler": "slideframe_standins.filler",
            "standin_solver": "slideframe_standins.solver",
            "standin_renderer": "slideframe_standins.renderer",
            "other_solver": "slideframe_standins.other",
        },
    )
    shutil.copytree(STANDINS, site, dirs_exist_ok=True)
    yield site
    for module in [name for name in sys.modules if name.startswith("slideframe_standins")]:
        del sys.modules[module]
