from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe_pose_rtk.marks import Mark, mark_files, photograph_number, read_marks
from slideframe_pose_rtk.metadata import PhotoRecord

# As a Phantom 4 RTK writes it; the second line lacks the week, as older firmware does.
LINES = (
    "1\t400373.488877\t[2264]\t   -40,N\t     0,E\t    86,V\t44.42824637,Lat\t1.26196331,Lon\t359.494,Ellh\t"
    "0.028, 0.031, 0.055\t16,Q\n"
    "2\t400376.5\t  -40.5,N\t 12,E\t 86,V\t-44.42824637,Lat\t-1.26196331,Lon\t-2.5,Ellh\t0.01, 0.02, 0.03\t50,Q\n"
)


def test_both_forms_of_a_line(tmp_path: Path) -> None:
    path = tmp_path / "100_0004_Timestamp.MRK"
    path.write_text(LINES)
    first, second = read_marks(path).values()
    assert first == Mark(
        number=1,
        time=400373.488877,
        week=2264,
        lever_arm=(-0.040, 0.0, 0.086),
        latitude=44.42824637,
        longitude=1.26196331,
        height=359.494,
        sigma=(0.031, 0.028, 0.055),  # the file states north before east
        flag=16,
    )
    assert (second.week, second.latitude, second.height, second.flag) == (None, -44.42824637, -2.5, 50)
    assert second.lever_arm == (-0.0405, 0.012, 0.086)


def test_a_damaged_line_is_told_by_number(tmp_path: Path) -> None:
    path = tmp_path / "flight_Timestamp.MRK"
    path.write_text(LINES + "3\t400379.1\t[2264]\t-40,N\n")
    with pytest.raises(InputError, match="line 3 is no time mark") as caught:
        read_marks(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("DJI_0012.JPG", 12),
        ("DJI_20241107101229_0345_V.JPG", 345),
        ("DJI_20241107101229_0007_MS_NIR.JPG", 7),
        ("100_0004_0012.JPG", 12),
        ("slope.jpg", None),
    ],
)
def test_numbers_in_names(name: str, number: int | None) -> None:
    assert photograph_number(PhotoRecord(path=Path(name), size=(4, 3))) == number


def test_files_are_found_in_any_case_beside_the_photographs_only(tmp_path: Path) -> None:
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
    for name in ("a/x.MRK", "b/y.mrk", "c/z.MRK"):
        (tmp_path / name).write_text("")
    found = mark_files([tmp_path / "a" / "1.JPG", tmp_path / "b" / "2.JPG", tmp_path / "a" / "3.JPG"])
    assert [path.name for path in found] == ["x.MRK", "y.mrk"]
