"""`slideframe compare`: the agreement ladder's figures for two runs of one problem."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import tyro

from slideframe.config import RunConfig, read_toml, validate
from slideframe.errors import ConfigurationError, InputError
from slideframe.products import Filling, ParticleFrame
from slideframe.run_folder import CONFIG, RESULT
from slideframe.store import Entry, Stream
from slideframe.verification.agreement import TOLERANCE, Comparison, compare

DISAGREE = 4
# at most this many output times are printed
TIMES = 12
PROBLEM = ("material", "boundary", "simulation")
# how a problem is solved, not what it is
TUNING = ("simulation.precision",)


@dataclass(frozen=True)
class CompareOptions:
    """Print how far two runs of one problem agree: centre of mass, run-out, deposit and energies.

    Exits with 4 when a figure differs by more than the tolerance.
    """

    first: Annotated[Path, tyro.conf.Positional]
    """Run folder."""
    second: Annotated[Path, tyro.conf.Positional]
    """Run folder of the same problem, of another solver for example."""
    tolerance: float = TOLERANCE
    """Largest relative difference of centre of mass, run-out, deposit profile and energies."""
    json: bool = False
    """Print JSON."""


@dataclass(frozen=True)
class Run:
    """A run folder with a motion."""

    folder: Path
    config: RunConfig
    filling_entry: Entry
    motion: Stream[ParticleFrame]

    @classmethod
    def open(cls, folder: Path) -> "Run":
        """Read a run folder.

        Raises:
            InputError: the folder holds no finished run with a solver, or the store that it points to is gone.
            ConfigurationError: its configuration isn't one of this version's.
        """
        try:
            keys = json.loads((folder / RESULT).read_text(encoding="utf-8"))["keys"]
            store = (folder / "particles").resolve(strict=True).parent
            entries = [Entry(store / f"{kind}-{keys[kind]}") for kind in ("volume_filler", "solver")]
        except (OSError, ValueError, KeyError) as error:
            raise InputError(
                f"no finished run with a motion is there: {type(error).__name__}: {error}",
                where=str(folder),
                cure="name the folder of a run that reached its solver, with its store beside it as it was",
            ) from error
        config = validate(RunConfig, read_toml(folder / CONFIG), str(folder / CONFIG))
        motion = cast(Stream[ParticleFrame], entries[1].read(ParticleFrame))
        return cls(folder, config, entries[0], motion)

    @property
    def filling(self) -> Filling:
        """The start."""
        return cast(Filling, self.filling_entry.read(Filling))


def main(arguments: Sequence[str]) -> int:
    """Print the figures; return 4 when the runs disagree."""
    options = tyro.cli(CompareOptions, args=list(arguments), prog="slideframe compare")
    first, second = Run.open(options.first), Run.open(options.second)
    refuse_different_problems(first, second)
    result = compare(first.motion, second.motion, first.filling, first.config.simulation_problem)
    print(json.dumps(_as_json(result), indent=1) if options.json else "\n".join(_table(result, first, second, options)))
    return 0 if result.agrees(options.tolerance) else DISAGREE


def refuse_different_problems(first: Run, second: Run) -> None:
    """Raise a ConfigurationError that names the keys by which the two problems differ."""
    mine, theirs = (dict(_keys(run.config.model_dump(mode="json"))) for run in (first, second))
    different = {key for key in mine.keys() | theirs.keys() if mine.get(key) != theirs.get(key)} - set(TUNING)
    wrong = {key for key in different if key.partition(".")[0] in PROBLEM}
    if first.filling_entry.content != second.filling_entry.content:
        solvers = {run.config.stages.solver for run in (first, second)} | {"solver", "renderer"}
        upstream = {key for key in different if key.partition(".")[0] not in (*PROBLEM, "view")}
        wrong |= {key for key in upstream if not solvers & set(key.split("."))}
        wrong = wrong or {"the filling itself, made by other versions of its stages"}
    if wrong:
        lines = [f"{key}: {mine.get(key)!r} in the first, {theirs.get(key)!r} in the second" for key in sorted(wrong)]
        raise ConfigurationError(
            "the runs are of different problems\n" + "\n".join(lines),
            where=f"{first.folder}, {second.folder}",
            cure="compare runs whose problem and filling are the same; solver, view and precision may differ",
        )


def _keys(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Give every leaf by its dotted key."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _table(result: Comparison, first: Run, second: Run, options: CompareOptions) -> Iterator[str]:
    yield f"A  {first.folder}: {first.config.stages.solver}, {first.config.simulation.precision}"
    yield f"B  {second.folder}: {second.config.stages.solver}, {second.config.simulation.precision}"
    yield f"\n{'at the end':<44}{'A':>14}{'B':>14}  difference"
    for figure in result.figures:
        off = figure.gated and figure.difference > options.tolerance
        share = f"{figure.difference:.2%} of {figure.of}" if figure.gated else f"{figure.difference:.3g} {figure.unit}"
        name = f"{figure.name}, {figure.unit}"
        yield f"{name:<44}{figure.first:>14.6g}{figure.second:>14.6g}  {share}{'  DISAGREE' if off else ''}"
    yield f"\n{'time, s':>10}{'kinetic energy A, J':>22}{'B':>14}{'potential energy A, J':>24}{'B':>14}"
    step = max(1, -(-(len(result.times) - 1) // TIMES))
    for index in range(0, len(result.times), step):
        kinetic, potential = result.kinetic[index], result.potential[index]
        energies = f"{kinetic[0]:>22.6g}{kinetic[1]:>14.6g}{potential[0]:>24.6g}{potential[1]:>14.6g}"
        yield f"{result.times[index]:>10.4g}{energies}"
    verdict = "agree" if result.agrees(options.tolerance) else "DISAGREE"
    yield f"\nthe runs {verdict} within {options.tolerance:.2%}"


def _as_json(result: Comparison) -> dict[str, Any]:
    return {
        "figures": [vars(figure) for figure in result.figures],
        "times_s": result.times.tolist(),
        "kinetic_energy_j": result.kinetic.tolist(),
        "potential_energy_j": result.potential.tolist(),
    }
