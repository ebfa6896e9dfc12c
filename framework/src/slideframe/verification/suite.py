"""Every case, in the order of the card."""

from collections.abc import Iterator

from slideframe.verification import (
    aluminium_bars,
    collapse,
    conservation,
    contact,
    elastic,
    elements,
    hold,
    invariance,
    slopes,
    terrain,
    vibration,
)
from slideframe.verification.case import Case

CASES: tuple[Case, ...] = (
    *elastic.CASES,
    *vibration.CASES,
    *hold.CASES,
    *elements.CASES,
    *conservation.CASES,
    *contact.CASES,
    *terrain.CASES,
    *invariance.CASES,
    *slopes.CASES,
    *collapse.CASES,
    *aluminium_bars.CASES,
)


def cases(fast: bool) -> Iterator[Case]:
    """Yield every case, or the fast ones alone."""
    return (case for case in CASES if case.fast or not fast)
