"""The reference's laws against a second implementation that shares nothing with it but the textbook.

The cone in terms of stress invariants, from the matrix logarithm of b = F F^T; the pyramid by the choice of planes of
de Souza Neto, Peric and Owen 2008 (box 8.2: main plane, then the edge by where the trial stress lies, then the apex).
"""

import numpy as np
import pytest
from scipy.linalg import logm

from slideframe.problem import DruckerPrager
from slideframe.reference.constitutive import kirchhoff_stress, return_mapping

SOIL = {"density": 1900, "youngs_modulus": 3e7, "poisson_ratio": 0.27, "cohesion": 4e4}
CASES = [(25.0, 0.0), (33.0, 12.0), (40.0, 40.0)]


def gradients(seed):
    """Random ones, and those whose principal stretches are equal by twos and threes, turned and not."""
    random = np.random.default_rng(seed)
    general = np.eye(3) + 0.02 * random.uniform(-1, 1, (24, 3, 3)) - 0.004 * np.eye(3)
    pairs = np.exp(0.01 * random.uniform(-2, 1, (6, 2)))[:, [0, 0, 1]] * 1.0
    stretches = np.concatenate([pairs, pairs[:, ::-1], np.repeat(pairs[:, :1], 3, axis=1), [[1.0, 1.0, 1.0]]])
    plain = np.array([np.diag(values) for values in stretches])
    rotations = np.linalg.qr(random.standard_normal((len(plain), 3, 3)))[0]
    return np.concatenate([general, plain, rotations @ plain @ np.swapaxes(rotations, 1, 2)])


def trial_stress(gradient, soil):
    strain = 0.5 * np.real(logm(gradient @ gradient.T))
    return 2 * soil.shear_modulus * strain + soil.lame_lambda * np.trace(strain) * np.eye(3)


def on_the_cone(stress, soil, friction, dilatancy):
    """Return to sqrt(J2) + 3 a p_t - k = 0 with potential sqrt(J2) + 3 b p_t, p_t the mean stress, tension positive."""
    sine = np.sin(np.radians(soil.friction_angle))
    k = 6 * soil.cohesion * np.cos(np.radians(soil.friction_angle)) / (np.sqrt(3) * (3 - sine))
    mean = np.trace(stress) / 3
    deviator = stress - mean * np.eye(3)
    root = np.sqrt(0.5 * np.tensordot(deviator, deviator))
    excess = root + 3 * friction * mean - k
    if excess <= 0:
        return stress
    flow = excess / (soil.shear_modulus + 9 * soil.bulk_modulus * friction * dilatancy)
    left = root - soil.shear_modulus * flow
    if left < 0:
        return k / (3 * friction) * np.eye(3)
    return deviator * left / root + (mean - 3 * soil.bulk_modulus * dilatancy * flow) * np.eye(3)


def on_the_pyramid(stress, soil):
    sf, sd = (np.sin(np.radians(angle)) for angle in (soil.friction_angle, soil.dilatancy_angle))
    limit = 2 * soil.cohesion * np.cos(np.radians(soil.friction_angle))
    values, axes = np.linalg.eigh(stress)
    low, middle, high = values
    if high - low + (high + low) * sf <= limit:
        return stress
    shear, bulk = soil.shear_modulus, soil.bulk_modulus
    a = 4 * shear * (1 + sf * sd / 3) + 4 * bulk * sf * sd
    flow = (high - low + (high + low) * sf - limit) / a
    ends = (
        2 * shear * (1 + sd / 3) + 2 * bulk * sd,
        (4 * shear / 3 - 2 * bulk) * sd,
        2 * shear * (1 - sd / 3) - 2 * bulk * sd,
    )
    high1, middle1, low1 = high - ends[0] * flow, middle + ends[1] * flow, low + ends[2] * flow
    if high1 >= middle1 - 1e-9 and middle1 >= low1 - 1e-9:
        return (axes * [low1, middle1, high1]) @ axes.T
    right = (1 - sd) * high - 2 * middle + (1 + sd) * low > 0
    if right:
        b = 2 * shear * (1 + sf + sd - sf * sd / 3) + 4 * bulk * sf * sd
        other = high - middle + (high + middle) * sf - limit
    else:
        b = 2 * shear * (1 - sf - sd - sf * sd / 3) + 4 * bulk * sf * sd
        other = middle - low + (middle + low) * sf - limit
    one, two = np.linalg.solve([[a, b], [b, a]], [high - low + (high + low) * sf - limit, other])
    if right:
        moved = (
            high - ends[0] * (one + two),
            middle + ends[1] * one + ends[2] * two,
            low + ends[2] * one + ends[1] * two,
        )
    else:
        moved = (
            high - ends[0] * one + ends[1] * two,
            middle + ends[1] * one - ends[0] * two,
            low + ends[2] * (one + two),
        )
    if moved[0] >= moved[1] - 1e-9 and moved[1] >= moved[2] - 1e-9:
        return (axes * moved[::-1]) @ axes.T
    return soil.cohesion / np.tan(np.radians(soil.friction_angle)) * np.eye(3)


@pytest.mark.parametrize(("friction_angle", "dilatancy_angle"), CASES)
@pytest.mark.parametrize("match", ["triaxial_compression", "mohr_coulomb"])
def test_two_implementations_of_one_law_agree(match, friction_angle, dilatancy_angle):
    soil = DruckerPrager(friction_angle=friction_angle, dilatancy_angle=dilatancy_angle, friction_match=match, **SOIL)
    trials = gradients(int(friction_angle))
    mapped = kirchhoff_stress(return_mapping(trials, np.zeros(len(trials)), soil).elastic, soil)
    before = np.array([trial_stress(trial, soil) for trial in trials])
    if match == "mohr_coulomb":
        expected = np.array([on_the_pyramid(stress, soil) for stress in before])
    else:
        sines = [np.sin(np.radians(angle)) for angle in (friction_angle, dilatancy_angle)]
        slopes = [2 * sine / (np.sqrt(3) * (3 - sine)) for sine in sines]
        expected = np.array([on_the_cone(stress, soil, *slopes) for stress in before])
    scale = np.abs(before).max(axis=(1, 2)) + soil.cohesion
    assert (np.abs(mapped - expected).max(axis=(1, 2)) <= 1e-9 * scale).all()
    yielded = np.abs(mapped - before).max(axis=(1, 2)) > 1e-6 * scale
    assert 0.15 < yielded.mean() < 0.95
