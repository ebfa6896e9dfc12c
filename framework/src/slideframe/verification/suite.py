"""Every case, in the order of the card.

Those in float64 come first, since Taichi compiles anew whenever the precision changes.
"""

from collections.abc import Iterator

from slideframe.verification import (
    aluminium_bars,
    collapse,
    conservation,
    contact,
    dam_break,
    elastic,
    elements,
    ground_slopes,
    hold,
    incline_collapse,
    invariance,
    slopes,
    terrain,
    transfers,
    vibration,
)
from slideframe.verification.case import Case

CASES: tuple[Case, ...] = (
    *elastic.CASES,
    *vibration.CASES,
    *elements.CASES,
    *invariance.CASES,
    *hold.CASES,
    *conservation.CASES,
    *transfers.CASES,
    *contact.CASES,
    *terrain.CASES,
    *slopes.CASES,
    *ground_slopes.CASES,
    *collapse.CASES,
    *incline_collapse.CASES,
    *dam_break.CASES,
    *aluminium_bars.CASES,
)


def cases(fast: bool) -> Iterator[Case]:
    """Yield every case, or the fast ones alone."""
    return (case for case in CASES if case.fast or not fast)
