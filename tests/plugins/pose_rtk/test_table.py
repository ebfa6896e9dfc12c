from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe_pose_rtk.table import read_table


def table(folder: Path, text: str) -> Path:
    path = folder / "positions.csv"
    path.write_text(text, encoding="utf-8-sig")
    return path


def test_all_columns(tmp_path: Path) -> None:
    text = (
        "# from the base station of 3 May\n"
        "Name;Latitude;Longitude;Ellipsoidal_Height;sigma_east;sigma_north;sigma_up;fix;yaw;pitch;roll\n"
        "a.JPG;22.3;114.2;61.5;0.01;0.02;0.03;float;10;-90;0\n"
        "\n"
        "b.JPG;22.4;114.3;62.5;;;;;;;\n"
    )
    read = read_table(table(tmp_path, text))
    first, second = read.positions
    assert read.geographic
    assert (first.name, first.line, first.x, first.y, first.height) == ("a.JPG", 3, 114.2, 22.3, 61.5)
    assert (first.sigma, first.fix, first.gimbal) == ((0.01, 0.02, 0.03), "float", (10.0, -90.0, 0.0))
    assert (second.sigma, second.fix, second.gimbal, second.altitude_kind) == (None, None, None, "ellipsoidal")


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize(("x", "y"), [("easting", "northing"), ("x", "y")])
def test_eastings_and_sea_level(tmp_path: Path, delimiter: str, x: str, y: str) -> None:
    rows = [["label", y, x, "orthometric_height"], ["a", "819000.5", "836000.25", "12"]]
    read = read_table(table(tmp_path, "\n".join(delimiter.join(row) for row in rows)))
    assert not read.geographic
    (only,) = read.positions
    assert (only.x, only.y, only.altitude_kind) == (836000.25, 819000.5, "orthometric")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "is empty"),
        ("name,latitude,longitude,height\na,1,2,3\n", "unknown meaning: height"),
        ("name,latitude,longitude\na,1,2\n", "exactly one of ellipsoidal_height or orthometric_height"),
        ("name,latitude,ellipsoidal_height\na,1,2\n", "exactly one of latitude with longitude or easting"),
        ("latitude,longitude,ellipsoidal_height\n1,2,3\n", "exactly one of name or file"),
        ("name,name,latitude,longitude,ellipsoidal_height\na,a,1,2,3\n", "two columns of the table"),
        (
            "name,latitude,longitude,ellipsoidal_height,yaw\na,1,2,3,4\n",
            "yaw, pitch, roll the table of positions has only some",
        ),
        ("name,latitude,longitude,ellipsoidal_height\na,1,2,high\n", "line 2 has no number in column 4"),
        ("name,latitude,longitude,ellipsoidal_height\na,1,2\n", "line 2 has no number in column 4"),
        ("name,latitude,longitude,ellipsoidal_height\na,1,nan,3\n", "line 2 has nan"),
        ("name,latitude,longitude,ellipsoidal_height,fix\na,1,2,3,rtk\n", "line 2 has the fix 'rtk'"),
        (
            "name,latitude,longitude,ellipsoidal_height,sigma_east,sigma_north,sigma_up\na,1,2,3,0,1,1\n",
            "isn't above zero",
        ),
        ("name,latitude,longitude,ellipsoidal_height\na,1,2,3\nA,1,2,3\n", "'A' stands in line 2 and in line 3"),
    ],
)
def test_what_cannot_be_meant(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        read_table(table(tmp_path, text))
    assert "positions.csv" in str(caught.value)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="can't be read"):
        read_table(tmp_path / "absent.csv")


def test_reads_what_a_survey_writes(tmp_path: Path) -> None:
    """The columns of slideframe.formats.position_table."""
    text = "name,easting,northing,orthometric_height,sigma_east,sigma_north,sigma_up\na/1.JPG,1,2,3,0.01,0.01,0.02\n"
    (position,) = read_table(table(tmp_path, text)).positions
    assert (position.name, position.sigma, position.altitude_kind) == ("a/1.JPG", (0.01, 0.01, 0.02), "orthometric")
