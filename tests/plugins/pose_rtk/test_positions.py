"""Which position wins, and that each is placed where it belongs."""

from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, InputError
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.georeferencing import Heights, from_geodetic
from slideframe.products import Georeference
from slideframe.stages import Context
from slideframe_pose_rtk.metadata import PhotoRecord, weight
from slideframe_pose_rtk.positions import PositionFiles, improve_positions
from slideframe_pose_rtk.trajectory import WEEK

ORIGIN = Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=150.0)
MILLIMETER = 1e-3


def record(folder: Path, number: int, fix: str = "float") -> PhotoRecord:
    latitude, longitude, height = geodetic_from_enu(np.array([[10.0 * number, 0.0, 0.0]]), ORIGIN)[0].tolist()
    return PhotoRecord(
        path=folder / f"DJI_{number:04d}.JPG",
        size=(4, 3),
        latitude=latitude,
        longitude=longitude,
        height=height,
        fix=fix,
        position_source="xmp",
        covariance=weight(fix, None),
    )


def east(found: PhotoRecord) -> float:
    return float(enu_from_geodetic(np.array([[found.latitude, found.longitude, found.height]]), ORIGIN)[0, 0])


def marks(folder: Path, count: int, *, flag: int = 50, shift: float = 1.0, lever: int = 0) -> None:
    """Write marks `shift` m east of the photographs' own positions, one every 2 s."""
    lines = []
    for number in range(1, count + 1):
        place = geodetic_from_enu(np.array([[10.0 * number + shift, 0.0, 0.0]]), ORIGIN)[0]
        lines.append(
            f"{number}\t{2.0 * number:.6f}\t[2243]\t0,N\t{lever},E\t0,V\t{place[0]:.9f},Lat\t{place[1]:.9f},Lon\t"
            f"{place[2]:.4f},Ellh\t0.011, 0.012, 0.013\t{flag},Q"
        )
    (folder / "100_0001_Timestamp.MRK").write_text("\n".join(lines))


def solution(folder: Path, *, quality: int = 1, shift: float = 2.0) -> None:
    """Write the antenna's way, `shift` m east of the photographs' own positions."""
    lines = ["%  GPST latitude(deg) longitude(deg) height(m) Q ns sdn sde sdu sdne sdeu sdun age ratio"]
    for time in np.arange(0, 12, 0.2):
        place = geodetic_from_enu(np.array([[5.0 * time + shift, 0.0, 0.0]]), ORIGIN)[0]
        lines.append(
            f"2243 {time:.3f} {place[0]:.10f} {place[1]:.10f} {place[2]:.4f} {quality} 9 .01 .02 .03 0 0 0 0.2 99"
        )
    (folder / "100_0001_PPK.pos").write_text("\n".join(lines))


def improve(folder: Path, records: list[PhotoRecord], context: Context, files: PositionFiles | None = None) -> list:
    return improve_positions(records, files or PositionFiles(), folder, Heights(), context)


def test_a_fixed_mark_replaces_a_float_position(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 3)
    improved = improve(tmp_path, [record(tmp_path, number) for number in (1, 2, 3, 4)], context)
    assert [found.position_source for found in improved] == ["mrk", "mrk", "mrk", "xmp"]
    assert east(improved[1]) == pytest.approx(21.0, abs=MILLIMETER)
    assert improved[1].position_sigma == pytest.approx((0.012, 0.011, 0.013))
    assert (improved[1].fix, improved[1].altitude_kind) == ("fixed", "ellipsoidal")


def test_a_better_position_of_the_photographs_own_stays(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 1, flag=16)
    (found,) = improve(tmp_path, [record(tmp_path, 1, "fixed")], context)
    assert found.position_source == "xmp"


def test_a_mark_of_another_place_is_refused_by_name(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 2, shift=400.0)
    improved = improve(tmp_path, [record(tmp_path, 1), record(tmp_path, 2)], context)
    assert {found.position_source for found in improved} == {"xmp"}
    assert "DJI_0001.JPG, DJI_0002.JPG" in context.warnings[0]


def test_a_photograph_without_a_position_takes_its_mark(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 1, flag=16)
    lost = record(tmp_path, 1).model_copy(update={"latitude": None, "longitude": None, "height": None, "fix": "none"})
    (found,) = improve(tmp_path, [lost], context)
    assert found.is_located


def test_a_post_processed_position_wins_with_the_lever_arm(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 3, lever=250)
    solution(tmp_path)
    improved = improve(tmp_path, [record(tmp_path, number, "fixed") for number in (1, 2, 3)], context)
    assert [found.position_source for found in improved] == ["ppk"] * 3
    assert east(improved[2]) == pytest.approx(30.0 + 2.0 + 0.25, abs=MILLIMETER)
    assert improved[2].position_sigma == pytest.approx((0.02, 0.01, 0.03))


def test_a_worse_post_processed_position_loses(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 1)
    solution(tmp_path, quality=5)
    (found,) = improve(tmp_path, [record(tmp_path, 1)], context)
    assert found.position_source == "mrk"


def test_files_beside_can_be_left_alone(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 1)
    files = PositionFiles(beside=False)
    assert improve(tmp_path, [record(tmp_path, 1)], context, files)[0].position_source == "xmp"
    assert files.paths([tmp_path / "DJI_0001.JPG"]) == []
    assert [path.suffix for path in PositionFiles().paths([tmp_path / "DJI_0001.JPG"])] == [".MRK"]


def write_table(folder: Path, text: str) -> Path:
    path = folder / "positions.csv"
    path.write_text(text)
    return path


def test_the_table_overrides_everything(tmp_path: Path, context: Context) -> None:
    marks(tmp_path, 2)
    place = geodetic_from_enu(np.array([[17.0, 0.0, 0.0]]), ORIGIN)[0]
    table = write_table(
        tmp_path,
        "name,latitude,longitude,ellipsoidal_height,sigma_east,sigma_north,sigma_up,yaw,pitch,roll\n"
        f"dji_0001.jpg,{place[0]:.10f},{place[1]:.10f},{place[2]:.4f},0.02,0.03,0.04,1,-2,3\n"
        "gone.jpg,1,2,3,1,1,1,0,0,0\n",
    )
    files = PositionFiles(table=table)
    first, second = improve(tmp_path, [record(tmp_path, 1, "fixed"), record(tmp_path, 2)], context, files)
    assert (first.position_source, second.position_source) == ("csv", "mrk")
    assert east(first) == pytest.approx(17.0, abs=MILLIMETER)
    assert first.position_sigma == pytest.approx((0.02, 0.03, 0.04))
    assert first.gimbal == (1.0, -2.0, 3.0)
    assert any("gone.jpg" in warning for warning in context.warnings)
    assert any("DJI_0002.JPG" in warning for warning in context.warnings)


@pytest.mark.parametrize("offset", [None, -2.4])
def test_a_table_in_the_hong_kong_grid(tmp_path: Path, context: Context, offset: float | None) -> None:
    x, y, _ = from_geodetic(geodetic_from_enu(np.array([[17.0, 0.0, 0.0]]), ORIGIN), 2326)[0]
    table = write_table(tmp_path, f"name,easting,northing,orthometric_height\nDJI_0001,{x:.4f},{y:.4f},152.4\n")
    files = PositionFiles(table=table, epsg=2326)
    (found,) = improve_positions([record(tmp_path, 1)], files, tmp_path, Heights(geoid_offset=offset), context)
    assert east(found) == pytest.approx(17.0, abs=MILLIMETER)
    expected = ("orthometric", 152.4) if offset is None else ("ellipsoidal", 150.0)
    assert (found.altitude_kind, found.height) == (expected[0], pytest.approx(expected[1], abs=MILLIMETER))


def test_names_that_could_be_two_photographs(tmp_path: Path, context: Context) -> None:
    table = write_table(tmp_path, "name,latitude,longitude,ellipsoidal_height\nDJI_0001.JPG,22.3,114.2,1\n")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    twice = [record(tmp_path / "a", 1), record(tmp_path / "b", 1)]
    with pytest.raises(InputError, match="may be"):
        improve(tmp_path, twice, context, PositionFiles(table=table))
    write_table(tmp_path, "name,latitude,longitude,ellipsoidal_height\nb/DJI_0001.JPG,22.3,114.2,1\n")
    improved = improve(tmp_path, twice, context, PositionFiles(table=table))
    assert [found.position_source for found in improved] == ["xmp", "csv"]


def test_a_table_for_other_photographs(tmp_path: Path, context: Context) -> None:
    table = write_table(tmp_path, "name,latitude,longitude,ellipsoidal_height\nIMG_1.JPG,22.3,114.2,1\n")
    with pytest.raises(InputError, match="none of its 1 names"):
        improve(tmp_path, [record(tmp_path, 1)], context, PositionFiles(table=table))


@pytest.mark.parametrize(("columns", "epsg"), [("latitude,longitude", 2326), ("easting,northing", None)])
def test_the_coordinate_system_must_go_with_the_columns(tmp_path: Path, columns: str, epsg: int | None) -> None:
    table = write_table(tmp_path, f"name,{columns},ellipsoidal_height\na,22.3,114.2,1\n")
    with pytest.raises(ConfigurationError, match=r"positions_epsg|coordinate system"):
        PositionFiles(table=table, epsg=epsg).require_readable([])


def test_the_weeks_of_the_marks_count(tmp_path: Path, context: Context) -> None:
    """A solution of another week is none for these marks."""
    marks(tmp_path, 1)
    solution(tmp_path)
    path = tmp_path / "100_0001_PPK.pos"
    path.write_text(path.read_text().replace("2243 ", "2244 "))
    assert WEEK == 7 * 86_400
    assert improve(tmp_path, [record(tmp_path, 1)], context)[0].position_source == "mrk"
