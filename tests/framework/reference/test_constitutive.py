"""The sand law against element tests with textbook answers, prescribed velocity gradient by velocity gradient."""

import numpy as np
import pytest

from slideframe.problem import DruckerPrager, Sand
from slideframe.reference.constitutive import SMALLEST_STRETCH, hencky_strain, kirchhoff_stress, return_mapping

# The strain path is followed in small steps; the cone is reached exactly, the path's other conditions by iteration.
STEPS = 400
STRENGTH_TOLERANCE = 2e-3


def sand(angle, match):
    return Sand(friction_angle=angle, density=2000, youngs_modulus=5e7, poisson_ratio=0.3, friction_match=match)


def earth(angle, match, cohesion=0.0):
    stiffness = {"density": 2000, "youngs_modulus": 5e7, "poisson_ratio": 0.3}
    return DruckerPrager(friction_angle=angle, friction_match=match, cohesion=cohesion, **stiffness)


def stress_of(gradient, law):
    return kirchhoff_stress(gradient[None], law)[0]


def step(gradient, change, law):
    return return_mapping(((np.eye(3) + change) @ gradient)[None], np.zeros(1), law).elastic[0]


def consolidated(pressure, law):
    """Return the state of isotropic compression, Pa."""
    bulk = law.lame_lambda + 2 * law.shear_modulus / 3
    return np.eye(3) * np.exp(-pressure / (3 * bulk))


def with_lateral_pressure(gradient, axial, pressure, law):
    """Strain axially by `axial` and find by secant the lateral strain that keeps the lateral stress."""
    lateral, previous = 0.0, -0.5 * axial
    error = stress_of(step(gradient, np.diag([previous, previous, axial]), law), law)[0, 0] + pressure
    for _ in range(20):
        trial = step(gradient, np.diag([lateral, lateral, axial]), law)
        miss = stress_of(trial, law)[0, 0] + pressure
        if abs(miss) < 1e-9 * pressure or miss == error:
            break
        lateral, previous, error = lateral - miss * (lateral - previous) / (miss - error), lateral, miss
    return trial


def triaxial(law, pressure, axial_step):
    gradient = consolidated(pressure, law)
    for _ in range(STEPS):
        gradient = with_lateral_pressure(gradient, axial_step, pressure, law)
    stress = -stress_of(gradient, law)
    return stress[2, 2], stress[0, 0]


@pytest.mark.parametrize("match", ["triaxial_compression", "mohr_coulomb"])
@pytest.mark.parametrize(
    ("cohesion", "angle", "pressure", "strength"),
    [(0, 30, 100e3, 200.000e3), (5e3, 35, 50e3, 153.718e3), (0, 22, 50e3, 59.899e3)],
)
def test_triaxial_compression(match, cohesion, angle, pressure, strength):
    """physics.md: q_f = sigma_3 (K_p - 1) + 2 c sqrt(K_p), of the pyramid and of the cone matched in compression."""
    axial, lateral = triaxial(earth(angle, match, cohesion), pressure, -5e-5)
    assert axial - lateral == pytest.approx(strength, rel=STRENGTH_TOLERANCE)


@pytest.mark.parametrize("match", ["triaxial_extension", "mohr_coulomb"])
def test_triaxial_extension(match):
    """physics.md: phi 30, lateral 100 kPa fails at an axial stress of 33.333 kPa."""
    axial, _ = triaxial(earth(30, match), 100e3, 5e-5)
    assert axial == pytest.approx(33.333e3, rel=STRENGTH_TOLERANCE)


def test_the_wrong_match_misses_the_strength():
    """Negative control: in extension the paper's cone is far too strong (22 degrees act as 29.95)."""
    axial, _ = triaxial(sand(30, "triaxial_compression"), 100e3, 5e-5)
    assert axial < 0.7 * 33.333e3


@pytest.mark.parametrize("match", ["plane_strain", "mohr_coulomb"])
@pytest.mark.parametrize(("angle", "ratio"), [(22, 0.3746), (30, 0.5), (35, 0.5736)])
def test_simple_shear(match, angle, ratio):
    """physics.md: at constant volume, plane-strain match, tau / sigma_n = sin(phi)."""
    law = sand(angle, match)
    gradient = consolidated(100e3, law)
    change = np.zeros((3, 3))
    change[0, 2] = 1e-4
    for _ in range(STEPS):
        gradient = step(gradient, change, law)
    stress = -stress_of(gradient, law)
    assert abs(stress[0, 2]) / stress[2, 2] == pytest.approx(ratio, rel=0.01)


def test_expansion_must_be_used_up_before_compression_meets_resistance():
    """Tampubolon et al. 2017: a burst and closed again leaves neither stress nor volume."""
    law = sand(30, "triaxial_compression")
    one, none = np.eye(3)[None], np.zeros(1)
    burst, correction, _ = return_mapping(1.1 * one, none, law)
    np.testing.assert_array_equal(burst, one)
    assert correction[0] == pytest.approx(3 * np.log(1.1))
    closed, correction, _ = return_mapping(burst / 1.1, correction, law)
    assert np.abs(stress_of(closed[0], law)).max() < 1e-12 * law.youngs_modulus
    pressed = return_mapping(closed * 0.999, correction, law).elastic
    assert stress_of(pressed[0], law)[0, 0] < 0


def test_elastic_states_keep_their_bits():
    gradient = np.array([[[0.999, 1e-5, 0], [0, 0.9991, 2e-6], [0, 0, 0.99895]]])
    mapped = return_mapping(gradient, np.zeros(1), sand(30, "triaxial_compression")).elastic
    assert mapped.tobytes() == gradient.tobytes()


def test_crushed_states_have_a_logarithm():
    flat = np.diag([1.0, 1.0, 0.0])[None]
    _, strain, _ = hencky_strain(flat)
    assert strain.min() == pytest.approx(np.log(SMALLEST_STRETCH))
