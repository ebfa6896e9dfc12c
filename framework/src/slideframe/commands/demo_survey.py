"""`slideframe demo-survey`: the photographs that `slideframe run` takes when no config is named."""

import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import Progress

DEMO_FOLDER = Path("runs") / "demo-survey"


@dataclass(frozen=True)
class DemoSurveyOptions:
    """Write the photographs of a synthetic slope, with the metadata of a real drone and the ground truth beside."""

    folder: Annotated[Path, tyro.conf.Positional] = DEMO_FOLDER
    """Where to write `photographs/` and `ground_truth/`."""
    width: int = 1200
    """Width of the photographs, px."""


def main(arguments: Sequence[str]) -> int:
    """Write the survey and say where it is."""
    options = tyro.cli(DemoSurveyOptions, args=list(arguments), prog="slideframe demo-survey")
    print(_write(options.folder, options.width))
    return 0


def demo_config() -> dict[str, Any]:
    """Return the embedded demo's config, its photographs and the true ground below the current folder."""
    content = tomllib.loads((files("slideframe.demo") / "demo.toml").read_text(encoding="utf-8"))
    content["site"]["photographs"] = str((DEMO_FOLDER / "photographs").resolve())
    content["reference_ground"]["path"] = str((DEMO_FOLDER / "ground_truth" / "terrain.asc").resolve())
    return content


def prepare_demo_survey() -> None:
    """Write the demo's photographs unless they are there."""
    _write(DEMO_FOLDER, DemoSurveyOptions.width)


def _write(folder: Path, width: int) -> Path:
    from slideframe.demo import write_demo_survey

    console = Console(file=sys.stderr)
    with Progress(console=console, disable=not console.is_terminal) as bars:
        task = bars.add_task("demo survey", total=None)
        return write_demo_survey(
            folder, width=width, progress=lambda done, total: bars.update(task, completed=done, total=total)
        )
