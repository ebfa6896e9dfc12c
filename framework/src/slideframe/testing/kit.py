"""Which checks a stage must pass, and two ways to run them: in a loop, and as pytest's parameters."""

import inspect
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from slideframe.stages import Stage
from slideframe.testing import (
    pose_source_checks,
    reconstructor_checks,
    renderer_checks,
    solver_checks,
    stage_checks,
    volume_filler_checks,
)

CheckFunction = Callable[[Any, Path], None]

_BY_KIND: dict[str, ModuleType] = {
    "pose_source": pose_source_checks,
    "reconstructor": reconstructor_checks,
    "volume_filler": volume_filler_checks,
    "solver": solver_checks,
    "renderer": renderer_checks,
}


@dataclass(frozen=True)
class Check:
    """One check of one stage; calling it raises AssertionError where the stage fails."""

    stage: Stage
    function: CheckFunction

    def __call__(self) -> None:
        """Run the check in an empty folder of its own."""
        with tempfile.TemporaryDirectory(prefix="slideframe-check-") as scratch:
            self.function(self.stage, Path(scratch))

    @property
    def name(self) -> str:
        """What is checked, such as `rest_stays_at_rest`."""
        return self.function.__name__.removeprefix("check_")

    @property
    def claim(self) -> str:
        """The check's statement in words."""
        return inspect.getdoc(self.function) or ""

    def __str__(self) -> str:
        return f"{self.stage.name}-{self.name}"


def checks_for(stage: Stage) -> list[Check]:
    """Return every check that a stage of this kind must pass, the cheapest first."""
    modules = (stage_checks, _BY_KIND[stage.kind])
    return [
        Check(stage, function)
        for module in modules
        for name, function in vars(module).items()
        if name.startswith("check_") and function.__module__ == module.__name__
    ]


def check_stage(stage: Stage) -> None:
    """Run all checks and raise one AssertionError that lists every failure."""
    failures = []
    for check in checks_for(stage):
        try:
            check()
        except AssertionError as failure:
            failures.append(f"{check.name}: {failure}")
    if failures:
        raise AssertionError(f"{stage.name} fails {len(failures)} checks:\n" + "\n".join(failures))


def parametrize_with_checks(*stages: Stage) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that runs a test `test(check)` once for each check of each stage."""
    import pytest

    checks = [check for stage in stages for check in checks_for(stage)]
    return pytest.mark.parametrize("check", checks, ids=str)
