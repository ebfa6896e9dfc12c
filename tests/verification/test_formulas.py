"""The closed-form solutions give the numbers of the literature."""

import math

import pytest

from slideframe.problem import Sand
from slideframe.verification import formulas, incline_collapse

PAPER = Sand(friction_angle=22, density=2000, youngs_modulus=5e7, poisson_ratio=0.3)


def test_the_papers_elasticity():
    assert PAPER.lame_lambda == pytest.approx(2.8846e7, rel=1e-4)
    assert PAPER.shear_modulus == pytest.approx(1.9231e7, rel=1e-4)
    assert PAPER.pressure_wave_speed == pytest.approx(183.450, abs=5e-4)
    assert math.sqrt(PAPER.shear_modulus / PAPER.density) == pytest.approx(98.058, abs=5e-4)


@pytest.mark.parametrize(("height", "settlement"), [(10.0, 0.01456), (60.0, 0.524)])
def test_column_settlement(height, settlement):
    modulus = PAPER.lame_lambda + 2 * PAPER.shear_modulus
    assert formulas.column_settlement(2000, 9.8, height, modulus) == pytest.approx(settlement, rel=1e-3)


def test_earth_pressure_at_rest():
    assert formulas.earth_pressure_at_rest(0.3) == pytest.approx(0.4286, abs=5e-5)


@pytest.mark.parametrize(
    ("angle", "friction", "expected"),
    [
        (30, 0.2, 3.205858),
        (35, math.tan(math.radians(22)), 2.380078),
        (40, math.tan(math.radians(22)), 3.269531),
        (20, math.tan(math.radians(22)), 0.0),
    ],
)
def test_incline(angle, friction, expected):
    assert formulas.incline_acceleration(angle, friction) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("friction_angle", "slope"), [(22, 20.5), (30, 26.6), (35, 29.8), (40, 32.7)])
def test_critical_slope(friction_angle, slope):
    assert formulas.critical_slope(friction_angle) == pytest.approx(slope, abs=0.06)


SLOPE = {"cohesion": 5e3, "friction_angle": 35.0, "unit_weight": 19e3, "depth": 2.0, "slope": 35.0}


@pytest.mark.parametrize(
    ("pore_pressure", "safety"),
    [(0.0, 1.280047), (0.25 * 19e3 * 2, 0.907474), (9.81e3 * 2 * math.cos(math.radians(35)) ** 2, 0.763731)],
    ids=["dry", "ru = 0.25", "saturated, flow parallel to the slope"],
)
def test_infinite_slope(pore_pressure, safety):
    assert formulas.infinite_slope_safety(**SLOPE, pore_pressure=pore_pressure) == pytest.approx(safety, abs=1e-6)


def test_cohesionless_infinite_slope():
    arguments = SLOPE | {"cohesion": 0.0, "friction_angle": 22.0}
    assert formulas.infinite_slope_safety(**arguments) == pytest.approx(0.577009, abs=1e-6)


@pytest.mark.parametrize(
    ("cohesion", "friction_angle", "confinement", "strength"),
    [(0, 30, 100, 200.0), (5, 35, 50, 153.718), (0, 22, 50, 59.899)],
)
def test_triaxial_strength(cohesion, friction_angle, confinement, strength):
    assert formulas.triaxial_strength(cohesion, friction_angle, confinement) == pytest.approx(strength, abs=1e-3)


def test_extension_strength():
    assert formulas.extension_strength(0, 30, 100) == pytest.approx(33.333, abs=1e-3)


def test_the_cone_of_matters_collapse_is_the_plane_strain_cone_of_its_angle():
    angle = incline_collapse.plane_strain_angle(30.0)
    assert angle == pytest.approx(35.264, abs=1e-3)
    sand = Sand(
        **PAPER.model_dump(exclude={"friction_angle", "friction_match"}),
        friction_angle=angle,
        friction_match="plane_strain",
    )
    # sqrt(J2) = 3 a p in terms of the mean stress
    assert 3 * sand.cone_friction == pytest.approx(math.tan(math.radians(30.0)))


def test_column_run_out_is_continuous():
    assert formulas.column_run_out(1.0) == pytest.approx(1.2)
    assert formulas.column_run_out(8.0) == pytest.approx(1.9 * 4)
    for joint in (1.8, 2.8):
        assert formulas.column_run_out(joint - 1e-9) == pytest.approx(formulas.column_run_out(joint + 1e-9))
