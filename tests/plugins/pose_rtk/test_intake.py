import csv
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import ValidationError

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


def test_the_planted_faults_of_a_real_survey(shared: Path, tmp_path: Path, photograph: Write, context: Context) -> None:
    """Faults that a mapping community planted into its test data, beside the photographs they were made from."""
    samples = shared / "data" / "metadata_samples"
    good = _rows(samples / "agung2_1817_poses_exiftool.csv")
    planted = _rows(samples / "agung2_issues.csv")
    stems = {row["FileName"].partition("_D")[0] for row in planted}
    beside = [row for row in good if row["FileName"].partition("_D")[0] in stems]
    for shade, row in enumerate([*beside, *planted]):
        values = {"GimbalRollDegree": "0", "GimbalYawDegree": row["FlightYawDegree"]}
        values |= {name: row[name] for name in ("AbsoluteAltitude", "GimbalPitchDegree")}
        values = {name: value for name, value in values.items() if value}
        for name in ("Latitude", "Longitude"):
            if row[f"GPS{name}"]:
                values[f"Gps{name}"] = f"{_degrees(row[f'GPS{name}']):.7f}"
        photograph(tmp_path / row["FileName"], values, shade=shade, taken=row["DateTimeOriginal"])
    kept = set(admitted(tmp_path, context))
    fate = {row["FileName"]: row["FileName"] in kept for row in planted}
    faults = ("MISSING_COORDS", "INVALID_COORD", "FAR_AWAY", "DUP", "MISSING_GIMBAL")  # the last lack a height too
    for name, is_kept in fate.items():
        assert is_kept != any(fault in name for fault in faults), name
    assert {row["FileName"] for row in beside} <= kept
    warned = "\n".join(context.warnings)
    for name in ("DUP", "INVALID_COORD", "GIMBAL_UP"):
        assert name in warned
    assert "looks above the horizon" in warned


def _rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def _degrees(printed: str) -> float:
    """Read exiftool's `8 deg 17' 39.30" S`."""
    degrees, minutes, seconds = (float(number) for number in re.findall(r"[\d.]+", printed))
    value = degrees + minutes / 60 + seconds / 3600
    return -value if printed[-1] in "SW" else value


def test_a_cut_off_photograph(folder: Path, context: Context) -> None:
    path = folder / GOOD[2]
    path.write_bytes(path.read_bytes()[:-40])
    assert admitted(folder, context) == [GOOD[0], GOOD[1], GOOD[3]]
    assert context.warnings == [f"{GOOD[2]} is left out: its picture is cut off: the file ends too early"]


def test_where_positions_come_from_is_stated(folder: Path, context: Context) -> None:
    (folder / "positions.csv").write_text("name,latitude,longitude,ellipsoidal_height\ngood1,22.2801,114.2,151\n")
    source = RtkPoses(positions=folder / "positions.csv")
    records, _ = admit(photograph_files(folder), folder, context, source._sources())
    assert context.figures["positions_from"] == {"csv": 1.0, "xmp": 3.0}
    assert [record.height for record in records] == [150.0, 151.0, 150.0, 150.0]
    assert folder / "positions.csv" in source.input_files(Site(photographs=folder))


def test_a_table_is_read_before_the_long_work(folder: Path) -> None:
    (folder / "positions.csv").write_text("name,latitude,longitude,height\ngood1,22.2801,114.2,151\n")
    with pytest.raises(InputError, match="unknown meaning: height"):
        RtkPoses(positions=folder / "positions.csv").preflight(Site(photographs=folder), Device())
    with pytest.raises(InputError, match="geoid grid can't be used"):
        RtkPoses(geoid_grid=folder / "absent.gtx").preflight(Site(photographs=folder), Device())
    (folder / "cameras.toml").write_text("[[camera]]\n")
    with pytest.raises(InputError, match="calibration"):
        RtkPoses(calibration=folder / "cameras.toml").preflight(Site(photographs=folder), Device())


def test_photographs_without_positions_and_a_table(folder: Path, photograph: Write, context: Context) -> None:
    rows = [f"{name},{22.28 + 1e-4 * number},114.2,150" for number, name in enumerate(GOOD)]
    for number, name in enumerate(GOOD):
        photograph(folder / name, {}, shade=number)
    (folder / "positions.csv").write_text("name,latitude,longitude,ellipsoidal_height\n" + "\n".join(rows))
    source = RtkPoses(positions=folder / "positions.csv")
    source.preflight(Site(photographs=folder), Device())
    records, _ = admit(photograph_files(folder), folder, context, source._sources())
    assert [record.position_source for record in records] == ["csv"] * 4


def test_a_camera_without_focal_length_needs_a_calibration(
    folder: Path, exif_photograph: Write, context: Context
) -> None:
    exif_photograph(folder / GOOD[0], 22.28, 114.2, 150.0)
    assert admitted(folder, context) == GOOD[1:]
    assert "no focal length" in context.warnings[0]
    (folder / "cameras.toml").write_text("[[camera]]\nwidth = 64\nheight = 48\nfocal_x = 50.0\n")
    source = RtkPoses(calibration=folder / "cameras.toml")
    records, _ = admit(photograph_files(folder), folder, context, source._sources())
    assert [record.path.name for record in records] == GOOD


def test_one_word_on_the_geoid_only() -> None:
    with pytest.raises(ValidationError, match="not both"):
        RtkPoses(geoid_offset=1.0, geoid_grid=Path("geoid.tif"))
