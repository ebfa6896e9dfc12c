"""What a run shows on the terminal: bars where there is one, else a line for each event."""

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from slideframe.bench import Bench, Keyed
from slideframe.run_folder import RESULT
from slideframe.stages import Stage

# seconds between two lines of one stage's progress where there is no terminal
LINE_INTERVAL = 15.0

# figures that tell how a run went, in the order of the pipeline
HEADLINES = (
    ("pose_source", "reprojection_error_px"),
    ("pose_source", "registered_photographs"),
    ("reconstructor", "held_out_psnr_db"),
    ("reconstructor", "splats"),
    ("volume_filler", "region_volume_m3"),
    ("volume_filler", "reference_rmse_m"),
    ("volume_filler", "particles"),
    ("solver", "substeps_per_second"),
    ("solver", "final_run_out_m"),
    ("renderer", "frames_per_second"),
)


class RateColumn(ProgressColumn):
    """Steps of a stage's own kind in a second: photographs, iterations, frames."""

    def render(self, task: Task) -> Text:
        """Show the recent rate."""
        return Text(f"{task.speed:.3g}/s" if task.speed else "")


class Silent:
    """A watcher that shows nothing."""

    def started(self, stage: Stage) -> None:
        """Show nothing."""

    def progress(self, stage: Stage, done: float, total: float, figures: Mapping[str, float]) -> None:
        """Show nothing."""

    def finished(self, stage: Stage, result: Keyed[Any], cached: bool) -> None:
        """Show nothing."""


class Watch:
    """A watcher that shows one bar for each stage, on stderr."""

    def __init__(self) -> None:
        """Look whether stderr is a terminal."""
        self._console = Console(stderr=True)
        self._bars: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._last_line = 0.0
        if self._console.is_terminal:
            self._bars = Progress(
                TextColumn("{task.description:<34}"),
                BarColumn(),
                TextColumn("{task.percentage:>3.0f} %"),
                RateColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                TextColumn("{task.fields[figures]}"),
                console=self._console,
            )

    def __enter__(self) -> "Watch":
        if self._bars:
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars:
            self._bars.stop()

    def started(self, stage: Stage) -> None:
        """Open the stage's bar."""
        self._show(f"{stage.kind} ({stage.name})", 0, 1, {})

    def progress(self, stage: Stage, done: float, total: float, figures: Mapping[str, float]) -> None:
        """Move the stage's bar."""
        self._show(f"{stage.kind} ({stage.name})", done, total, figures)

    def delivering(self, what: str, done: float, total: float) -> None:
        """Move the bar of an output file."""
        self._show(f"writing the {what}", done, total, {})

    def finished(self, stage: Stage, result: Keyed[Any], cached: bool) -> None:
        """Close the stage's bar, and state what the stage warned of."""
        manifest = result.entry.manifest
        seconds = manifest["figures"]["wall_seconds"]
        label = f"{stage.kind} ({stage.name})"
        if label in self._tasks and self._bars:
            self._bars.update(self._tasks[label], completed=1, total=1)
        else:
            self._console.print(
                f"{label}: {'already in the store' if cached else f'done in {seconds:.1f} s'}", highlight=False
            )
        for warning in manifest["warnings"]:
            self._console.print(f"  warning: {warning}", style="yellow", highlight=False, markup=False)

    def _show(self, label: str, done: float, total: float, figures: Mapping[str, float]) -> None:
        text = "  ".join(f"{name} {value:.4g}" for name, value in figures.items())
        if self._bars:
            if label not in self._tasks:
                self._tasks[label] = self._bars.add_task(label, total=total, figures=text)
            self._bars.update(self._tasks[label], completed=done, total=total, figures=text)
        elif done == 0 or time.monotonic() - self._last_line > LINE_INTERVAL:
            self._last_line = time.monotonic()
            share = f"{100 * done / total:3.0f} %" if total else ""
            self._console.print(f"{label}: {share}  {text}".rstrip(), highlight=False)


def print_plan(plan: Bench) -> None:
    """Say of each stage whether its result is in the store, and under which key where that is known."""
    for kind, result in plan.results.items():
        print(f"{kind:<15} {'to do' if kind in plan.computed else 'in the store':<13} {result.key}".rstrip())


def print_result(folder: Path) -> None:
    """Print the headline figures of a finished run and where its files lie."""
    result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    table = Table(show_header=False, box=None)
    for kind, figure in HEADLINES:
        value = result.get(kind, {}).get(figure)
        if value is not None:
            table.add_row(f"{kind}.{figure}", f"{value:.5g}" if isinstance(value, float) else str(value))
    Console(file=sys.stdout).print(table)
    print(f"\nresults in {folder}: {', '.join(sorted(item.name for item in folder.iterdir() if item.name[0] != '.'))}")
    print(f"look at them with: slideframe view {folder}")
