from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.products import Georeference
from slideframe_pose_rtk.trajectory import LEAP_SECONDS, WEEK, AntennaPosition, camera_position, read_trajectory

ORIGIN = Georeference(latitude=44.4, longitude=1.26, ellipsoidal_height=300.0)
COLUMNS = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio"
DEVIATIONS = "0.010 0.020 0.030 0.005 -0.006 0.007"
STEP = 0.2  # s
PRINTED = 2e-4  # m, nine decimals of a degree and four of a metre


def place(time: np.ndarray) -> np.ndarray:
    """A turn of 30 m radius at 10 m/s: an acceleration of 3.3 m/s², more than a survey flight has."""
    angle = 10.0 * time / 30.0
    return np.column_stack([30 * np.sin(angle), 30 * (1 - np.cos(angle)), 2 * np.sin(time)])


def write(path: Path, *, header: str = "%  GPST", calendar: bool = False, leave_out: tuple[int, ...] = ()) -> Path:
    times = np.arange(20) * STEP
    lines = ["% program   : RTKLIB", f"{header}  {COLUMNS}"]
    for row, (time, geodetic) in enumerate(zip(times, geodetic_from_enu(place(times), ORIGIN), strict=True)):
        # 1 January 2023, 00:00:00 is second 0 of GPS week 2243
        stamp = f"2023/01/01 00:00:{time:06.3f}" if calendar else f"2243 {time:10.3f}"
        if row not in leave_out:
            quality = 2 if row == 5 else 1
            lines.append(
                f"{stamp} {geodetic[0]:.9f} {geodetic[1]:.9f} {geodetic[2]:.4f} {quality} 12 {DEVIATIONS} 0.2 999.9"
            )
    path.write_text("\n".join(lines) + "\n")
    return path


def local(position: AntennaPosition) -> np.ndarray:
    return enu_from_geodetic(np.array([[position.latitude, position.longitude, position.height]]), ORIGIN)[0]


@pytest.mark.parametrize("calendar", [False, True])
def test_positions_between_epochs(tmp_path: Path, calendar: bool) -> None:
    trajectory = read_trajectory(write(tmp_path / "a.pos", calendar=calendar))
    for time in (0.05, 1.37, 2.0, 3.79):
        found = trajectory.at(2243 * WEEK + time)
        assert found is not None
        np.testing.assert_allclose(local(found), place(np.array([time]))[0], atol=0.002)
    exact = trajectory.at(2243 * WEEK + 2.0)
    assert exact is not None
    np.testing.assert_allclose(local(exact), place(np.array([2.0]))[0], atol=PRINTED)


def test_quality_and_covariance_are_the_worse_neighbours(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path / "a.pos"))
    sure, unsure = trajectory.at(2243 * WEEK + 2.1), trajectory.at(2243 * WEEK + 1.0)
    assert sure is not None
    assert unsure is not None
    assert (sure.fix, unsure.fix) == ("fixed", "float")
    expected = [[4e-4, 25e-6, -36e-6], [25e-6, 1e-4, 49e-6], [-36e-6, 49e-6, 9e-4]]  # east, north, up
    np.testing.assert_allclose(sure.covariance, expected, rtol=1e-9)


def test_no_position_outside_or_in_a_gap(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path / "a.pos", leave_out=tuple(range(6, 14))))
    for time in (-0.1, 3.9, 1.9):
        assert trajectory.at(2243 * WEEK + time) is None, time
    assert trajectory.at(2243 * WEEK + 0.9) is not None


def test_coordinated_universal_time(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path / "a.pos", header="%  UTC", calendar=True))
    found = trajectory.at(2243 * WEEK + LEAP_SECONDS + 1.0)
    assert found is not None
    np.testing.assert_allclose(local(found), place(np.array([1.0]))[0], atol=PRINTED)


def test_heights_above_the_geoid_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.pos")
    path.write_text("% (lat/lon/height=WGS84/geodetic,Q=1:fix)\n" + path.read_text())
    assert read_trajectory(path).altitude_kind == "orthometric"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("%  GPST  x-ecef(m) y-ecef(m) z-ecef(m)\n", "isn't in latitude"),
        (f"%  JST  {COLUMNS}\n", "neither GPS time nor UTC"),
        (f"%  GPST  {COLUMNS}\n", "holds no solution"),
        (f"%  GPST  {COLUMNS}\n2243 1.0 44.4 1.26 300.0 1 12\n", "line 2 is no position"),
        (f"%  GPST  {COLUMNS}\n2243 1.0 north 1.26 300.0 1 12 {DEVIATIONS}\n", "line 2 is no position"),
    ],
)
def test_files_of_another_kind(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "a.pos"
    path.write_text(text)
    with pytest.raises(InputError, match=what):
        read_trajectory(path)


def test_the_lever_arm_leads_from_antenna_to_camera() -> None:
    antenna = AntennaPosition(44.4, 1.26, 300.0, np.eye(3), "fixed")
    latitude, longitude, height = camera_position(antenna, (0.1, -0.2, 0.086))  # north, east, down
    found = enu_from_geodetic(np.array([[latitude, longitude, height]]), ORIGIN)[0]
    np.testing.assert_allclose(found, [-0.2, 0.1, -0.086], atol=1e-8)
