"""The verification card: one line for each quantity, with what theory or measurement expects and what a solver gave."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Line:
    """One quantity of one solver.

    Attributes:
        name: what is measured, its parameters included.
        unit: of `expected`, `got` and `tolerance`; empty for a ratio.
        expected: by theory or measurement.
        got: by the solver; NaN where it gave none.
        tolerance: largest allowed |got - expected|.
        source: formula or publication.
        note: why there is no number, where there is none.
    """

    name: str
    unit: str
    expected: float
    got: float
    tolerance: float
    source: str
    note: str = ""

    @property
    def passed(self) -> bool:
        """Whether the solver's number lies within the tolerance; NaN never does."""
        return bool(abs(self.got - self.expected) <= self.tolerance)

    def as_json(self, solver: str) -> dict[str, Any]:
        """Return the line as JSON takes it; a number that isn't there is null."""
        return {
            "solver": solver,
            "name": self.name,
            "unit": self.unit,
            "expected": _finite(self.expected),
            "got": _finite(self.got),
            "tolerance": _finite(self.tolerance),
            "passed": self.passed,
            "source": self.source,
            "note": self.note,
        }


HEADER = f"{'':<6}  {'quantity':<62}  {'expected':>11}  {'got':>11}  {'tolerance':>9}  source"


def row(line: Line) -> str:
    """Return one row of the printed card, under HEADER."""
    name = f"{line.name}, {line.unit}" if line.unit else line.name
    numbers = f"{_short(line.expected):>11}  {_short(line.got):>11}  {_short(line.tolerance):>9}"
    verdict = "ok" if line.passed else "FAILED"
    return f"{verdict:<6}  {name:<62}  {numbers}  {line.source}" + (f"\n{'':<8}{line.note}" if line.note else "")


def summary(solver: str, lines: Sequence[Line]) -> str:
    """Return the sentence below a solver's card."""
    failed = sum(not line.passed for line in lines)
    return f"{solver}: {len(lines) - failed} of {len(lines)} lines hold" + (f", {failed} FAILED" if failed else "")


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _short(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else "-"
