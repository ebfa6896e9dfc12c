"""Contact sheet and comparison."""

import numpy as np
import pytest

from slideframe.stills import GAP, LABEL, SHEET_WIDTH, contact_sheet, side_by_side


def picture(index: int):
    return np.full((90, 160, 3), 20 * index, np.uint8), 0.04 * index


@pytest.mark.parametrize(("count", "shown", "expected"), [(11, 4, [0, 3, 7, 10]), (3, 12, [0, 1, 2]), (1, 5, [0])])
def test_a_sheet_shows_pictures_evenly_from_the_first_to_the_last(count, shown, expected):
    asked: list[int] = []

    def recorded(index: int):
        asked.append(index)
        return picture(index)

    sheet = np.asarray(contact_sheet(recorded, count, shown))
    assert asked[1:] == expected  # the first call asks for the size
    columns = int(np.ceil(np.sqrt(len(expected))))
    width = (SHEET_WIDTH - GAP) // columns - GAP
    height = round(width * 90 / 160)
    for place, index in enumerate(expected):
        left = GAP + place % columns * (width + GAP)
        top = GAP + place // columns * (height + LABEL + GAP)
        assert (sheet[top : top + height, left : left + width] == 20 * index).all()


def test_before_stands_beside_after():
    sheet = np.asarray(side_by_side([(picture(1)[0], "before"), (picture(9)[0], "after")]))
    assert sheet.shape == (90 + LABEL + 2 * GAP, 2 * 160 + 3 * GAP, 3)
    assert (sheet[-50, GAP : GAP + 160] == 20).all()
    assert (sheet[-50, 2 * GAP + 160 : 2 * GAP + 320] == 180).all()
