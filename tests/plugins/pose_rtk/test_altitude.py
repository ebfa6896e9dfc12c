from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe.georeferencing import Heights
from slideframe.stages import Context
from slideframe_pose_rtk.altitude import UNDULATION_SIGMA, AltitudeRules, settle_altitudes
from slideframe_pose_rtk.metadata import PhotoRecord


def record(kind: str, height: float = 100.0, words: str = "") -> PhotoRecord:
    return PhotoRecord(
        path=Path(f"{kind}.jpg"),
        size=(4, 3),
        latitude=22.3,
        longitude=114.2,
        height=height,
        altitude_kind=kind,
        altitude_words=words,
        covariance=((1e-4, 2e-5, 1e-6), (2e-5, 1e-4, 1e-6), (1e-6, 1e-6, 4e-4)),
    )


def test_ellipsoidal_heights_need_no_word(context: Context) -> None:
    records = [record("ellipsoidal"), record("ellipsoidal")]
    assert settle_altitudes(records, AltitudeRules(), context) == records
    assert not context.warnings


def test_sea_level_becomes_ellipsoidal_with_an_undulation(context: Context) -> None:
    rules = AltitudeRules(Heights(geoid_offset=-2.4))
    plain, raised = settle_altitudes([record("ellipsoidal"), record("orthometric")], rules, context)
    assert (plain.height, raised.height, raised.altitude_kind) == (100.0, pytest.approx(97.6), "ellipsoidal")
    assert raised.position_sigma == plain.position_sigma
    assert not context.warnings


@pytest.mark.parametrize("kind", ["orthometric", "relative", "unknown"])
def test_levels_that_mix_are_named_and_doubted(context: Context, kind: str) -> None:
    plain, other = settle_altitudes([record("ellipsoidal"), record(kind, words="ItsWord")], AltitudeRules(), context)
    assert plain == record("ellipsoidal")
    assert other.position_sigma[2] == UNDULATION_SIGMA
    assert other.position_sigma[:2] == plain.position_sigma[:2]
    assert other.height == 100.0, "nothing is guessed"
    assert other.covariance[0][1] == 2e-5
    (warning,) = context.warnings
    assert f"{kind}.jpg" in warning
    assert "ItsWord" in warning
    assert "count for little" in warning


def test_levels_that_mix_are_refused_where_nothing_adjusts_them(context: Context) -> None:
    rules = AltitudeRules(mixed_refused=True)
    with pytest.raises(InputError, match=r"different levels.*1 ellipsoidal \(ellipsoidal\.jpg\); 1 unknown"):
        settle_altitudes([record("ellipsoidal"), record("unknown")], rules, context)
    assert len(settle_altitudes([record("unknown"), record("unknown")], rules, context)) == 2


@pytest.mark.parametrize("kind", ["orthometric", "relative", "unknown"])
def test_one_level_keeps_its_weight_and_is_told(context: Context, kind: str) -> None:
    records = settle_altitudes([record(kind), record(kind)], AltitudeRules(), context)
    assert records[0].position_sigma[2] == pytest.approx(0.02)
    assert "absolute height may be tens of metres off" in context.warnings[0]


@pytest.mark.parametrize(
    ("unstated", "offset", "kind", "height"),
    [
        ("ellipsoidal", None, "ellipsoidal", 100.0),
        ("orthometric", None, "orthometric", 100.0),
        ("orthometric", 30.0, "ellipsoidal", 130.0),
        ("unknown", 30.0, "unknown", 100.0),
    ],
)
def test_the_users_word_on_unstated_levels(
    context: Context, unstated: str, offset: float | None, kind: str, height: float
) -> None:
    rules = AltitudeRules(Heights(geoid_offset=offset), unstated)
    (found,) = settle_altitudes([record("unknown")], rules, context)
    assert (found.altitude_kind, found.height) == (kind, height)
