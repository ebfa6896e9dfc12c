from collections.abc import Callable
from pathlib import Path

import pytest

from slideframe.device import Device
from slideframe.errors import InputError
from slideframe.problem import Site
from slideframe.stages import Context
from slideframe_pose_rtk.flight import plan_flight
from slideframe_pose_rtk.intake import admit, photograph_files
from slideframe_pose_rtk.source import RtkPoses

Write = Callable[..., Path]


@pytest.fixture
def folder(tmp_path: Path, photograph: Write, drone_metadata) -> Path:
    """Four good photographs, 11 m apart."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(4):
        photograph(folder / f"good{number}.JPG", drone_metadata(22.28 + 1e-4 * number, 114.2, 150.0), shade=number)
    return folder


def admitted(folder: Path, context: Context) -> list[str]:
    records, digests = admit(photograph_files(folder), folder, context)
    assert len(records) == len(digests)
    return [record.path.name for record in records]


GOOD = ["good0.JPG", "good1.JPG", "good2.JPG", "good3.JPG"]


def test_files_are_found_in_any_case_and_below(folder: Path, photograph: Write, drone_metadata) -> None:
    (folder / "b").mkdir()
    photograph(folder / "b" / "below.jpeg", drone_metadata(1, 2, 3))
    (folder / "notes.txt").write_text("no photograph")
    assert [path.name for path in RtkPoses().input_files(Site(photographs=folder))] == ["below.jpeg", *GOOD]


@pytest.mark.parametrize("kind", ["missing", "a file", "empty"])
def test_a_folder_without_photographs(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "place"
    if kind == "a file":
        place.write_text("")
    if kind == "empty":
        place.mkdir()
    with pytest.raises(InputError, match="folder") as caught:
        RtkPoses().preflight(Site(photographs=place), Device())
    assert str(place) in str(caught.value)
    assert caught.value.cure


def test_preflight_requires_three_with_a_position(folder: Path, photograph: Write) -> None:
    RtkPoses().preflight(Site(photographs=folder), Device())
    for name in GOOD[:2]:
        photograph(folder / name, {})
    with pytest.raises(InputError, match=r"at least 3 photographs with a position .* there are 2"):
        RtkPoses().preflight(Site(photographs=folder), Device())


def test_what_is_left_out_is_named_and_the_rest_goes_on(
    folder: Path, photograph: Write, drone_metadata, context: Context
) -> None:
    photograph(folder / "indoors.jpg", {})
    photograph(folder / "paris.jpg", drone_metadata(48.8566, 2.3522, 150.0))
    photograph(folder / "bomb.jpg", packet=b'<!DOCTYPE l [<!ENTITY a "ha">]><x>&a;</x>')
    (folder / "letter.JPG").write_text("Dear drone,")
    (folder / "twin.jpg").write_bytes((folder / GOOD[0]).read_bytes())
    assert admitted(folder, context) == GOOD
    warned = "\n".join(context.warnings)
    for name in ("indoors.jpg", "paris.jpg", "bomb.jpg", "letter.JPG", "twin.jpg"):
        assert warned.count(name) == 1, name
    assert "good0.JPG" in warned, "the file that the twin repeats"
    assert len(context.warnings) == 5


def test_two_photographs_only(folder: Path, context: Context) -> None:
    for name in GOOD[:2]:
        (folder / name).unlink()
    with pytest.raises(InputError, match="at least 3 photographs"):
        RtkPoses().locate(Site(photographs=folder), context)


def test_all_from_one_point(folder: Path, photograph: Write, drone_metadata, context: Context) -> None:
    for shade, name in enumerate(GOOD):
        photograph(folder / name, drone_metadata(22.28, 114.2, 150.0), shade=shade)
    with pytest.raises(InputError, match="from one point"):
        RtkPoses().locate(Site(photographs=folder), context)


def test_zero_gimbal_angles_everywhere(folder: Path, photograph: Write, drone_metadata, context: Context) -> None:
    for shade, name in enumerate(GOOD):
        photograph(folder / name, drone_metadata(22.28 + 1e-4 * shade, 114.2, 150, yaw=0, pitch=0), shade=shade)
    with pytest.raises(InputError, match="gimbal angles are needed, and 0 of 4"):
        RtkPoses().locate(Site(photographs=folder), context)


def test_pictures_that_show_nothing(folder: Path, context: Context) -> None:
    with pytest.raises(InputError, match="no two photographs show the same ground"):
        RtkPoses().locate(Site(photographs=folder), context)


def test_heights_of_another_datum_are_told_and_doubted(
    folder: Path, photograph: Write, drone_metadata, context: Context
) -> None:
    photograph(folder / GOOD[1], drone_metadata(22.2801, 114.2, 150.0) | {"AltitudeType": "PressureAlt"}, shade=9)
    records, _ = admit(photograph_files(folder), folder, context)
    flight = plan_flight(records, folder, None, context)
    assert flight.position_sigma[1, 2] > 10 > flight.position_sigma[0, 2], "the geoid may lie tens of metres off"
    assert any("PressureAlt" in warning and "good1.JPG" in warning for warning in context.warnings)
