"""`slideframe verify`: the verification card of the installed solvers."""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import tyro

from slideframe import catalogue, registry
from slideframe.crew import device_for
from slideframe.device import parse_device
from slideframe.errors import ConfigurationError
from slideframe.stages import Solver
from slideframe.verification.card import HEADER, Line, row, summary
from slideframe.verification.rig import Rig
from slideframe.verification.suite import cases

REFERENCE = "reference"
FAILED = 4


@dataclass(frozen=True)
class VerifyOptions:
    """Check solvers against closed-form solutions and measurements, and print the verification card.

    Exits with 4 when a line fails.
    """

    solver: str | None = None
    """One solver: reference, or a plugin's name. By default the reference and every installed solver."""
    fast: bool = False
    """Only the cases that take seconds."""
    json: bool = False
    """Print JSON: a list with one object for each line."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""


def main(arguments: Sequence[str]) -> int:
    """Print the card; return 4 when a line fails."""
    options = tyro.cli(VerifyOptions, args=list(arguments), prog="slideframe verify")
    device = parse_device(options.device)
    rows: list[dict[str, Any]] = []
    for solver in chosen_solvers(options.solver):
        lines = []
        rig = Rig(solver, device_for(solver, device))
        if not options.json:
            print(f"{solver.name} on {rig.device}\n{HEADER}")
        for line in _lines(rig, options.fast):
            lines.append(line)
            print(f"{solver.name}: {line.name}" if options.json else row(line), file=_stream(options), flush=True)
        rows += [line.as_json(solver.name) for line in lines]
        if not options.json:
            print(summary(solver.name, lines) + "\n")
    if options.json:
        print(json.dumps(rows, indent=1, allow_nan=False))
    return 0 if all(entry["passed"] for entry in rows) else FAILED


def _stream(options: VerifyOptions) -> Any:
    """Progress of a JSON card goes to where it doesn't spoil it."""
    return sys.stderr if options.json else sys.stdout


def _lines(rig: Rig, fast: bool) -> Iterator[Line]:
    for case in cases(fast):
        yield from case.lines(rig)


def chosen_solvers(name: str | None) -> list[Solver]:
    """Return the named solver, or the reference and all that are installed, each with its own defaults.

    Raises:
        ConfigurationError: the plugin of that name is no solver.
        MissingDependency: a solver's backend isn't installed.
    """
    from slideframe.reference.solver import ReferenceSolver

    if name == REFERENCE:
        return [ReferenceSolver()]
    if name is not None:
        return [_load(name)]
    installed = [listing.name for listing in catalogue.installed() if listing.kind == Solver.kind]
    return [ReferenceSolver(), *map(_load, installed)]


def _load(name: str) -> Solver:
    stage = registry.load([name])[name]
    if not issubclass(stage, Solver):
        raise ConfigurationError(
            f"'{name}' is a {stage.kind}, not a solver",
            where="--solver",
            cure="see `slideframe plugins` for those of kind solver, or use --solver reference",
        )
    registry.require_backend(stage, catalogue.find(name))
    return stage()
