"""What a case is: a problem with a known answer, and how to read a solver's answer."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from slideframe.errors import SlideframeError
from slideframe.verification.card import Line
from slideframe.verification.rig import Rig

Measurement = Callable[[Rig], Iterator[Line]]


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        name: in words.
        measure: drives the rig and yields lines of the card.
        fast: whether it belongs to the part that takes seconds.
    """

    name: str
    measure: Measurement
    fast: bool = False

    def lines(self, rig: Rig) -> Iterator[Line]:
        """Yield the case's lines; a solver that refuses or fails yields a line that failed and says why."""
        try:
            yield from self.measure(rig)
        except SlideframeError as error:
            nothing = float("nan")
            yield Line(self.name, "", nothing, nothing, nothing, "", note=str(error.what))
