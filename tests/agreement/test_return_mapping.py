"""Pointwise: both backends' return mapping against the float64 reference on random deformation gradients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.device import Device
from slideframe.problem import Sand
from slideframe.reference.constitutive import cone_slope, hencky_strain, return_mapping

# physics.md: 1e-5 and 1e-10. b = F F^T has the square of F's condition, so the strain of a particle
# crushed in one direction has lost that much of float32 already in its state.
TOLERANCE = {"float32": 1e-5, "float64": 1e-10}
BATCH = 4000


def random_gradients(seed, scale):
    """Deformation gradients from tiny to large strain, sheared, stretched and crushed up to a condition of 10."""
    random = np.random.default_rng(seed)
    gradients = np.eye(3) + scale * random.uniform(-1, 1, (BATCH, 3, 3))
    gradients -= scale * random.uniform(0, 0.7, (BATCH, 1, 1)) * np.eye(3)
    sound = (np.linalg.det(gradients) > 0.02) & (np.linalg.cond(gradients) < 10)
    gradients = gradients[sound]
    corrections = np.where(random.random(len(gradients)) < 0.5, 0, scale * random.uniform(0, 0.3, len(gradients)))
    return gradients, corrections


def by_warp(states, corrections, slope, precision):
    import warp as wp

    from slideframe_mpm_warp.runtime import kernels_in
    from slideframe_mpm_warp.stepper import JACOBI_SWEEPS

    kernels = kernels_in(precision, "cpu")
    level, wp.config.log_level = wp.config.log_level, wp.LOG_ERROR

    @wp.kernel(module="unique", enable_backward=False)
    def map_states(
        states: wp.array(dtype=kernels.Matrix),
        corrections: wp.array(dtype=kernels.Real),
        slope: kernels.Real,
        sweeps: int,
        strains: wp.array(dtype=kernels.Matrix),
    ):
        particle = wp.tid()
        state, strain, correction = kernels.return_mapping(states[particle], corrections[particle], slope, sweeps)
        states[particle] = state
        strains[particle] = strain
        corrections[particle] = correction

    with wp.ScopedDevice("cpu"):
        x = wp.array(states.astype(precision), dtype=kernels.Matrix)
        v = wp.array(corrections.astype(precision), dtype=kernels.Real)
        h = wp.zeros(len(states), dtype=kernels.Matrix)
        wp.launch(map_states, dim=len(states), inputs=[x, v, slope, JACOBI_SWEEPS, h])
    wp.config.log_level = level
    return x.numpy().copy(), h.numpy().copy(), v.numpy().copy()


def by_taichi(states, corrections, slope, precision):
    from slideframe_mpm_taichi.runtime import session
    from slideframe_mpm_taichi.stepper import SERIES_RADIUS

    with session(Device(), precision):
        import taichi as ti

        from slideframe_mpm_taichi.kernels import return_mapping as law

        @ti.kernel
        def map_states(
            states: ti.types.ndarray(),
            corrections: ti.types.ndarray(),
            slope: float,
            radius: float,
            strains: ti.types.ndarray(),
        ):
            for particle in range(states.shape[0]):
                state, strain, correction = law(states[particle], corrections[particle], slope, radius)
                states[particle] = state
                strains[particle] = strain
                corrections[particle] = correction

        real = ti.f64 if precision == "float64" else ti.f32
        matrix = ti.types.matrix(3, 3, real)
        x, h, v = ti.ndarray(matrix, len(states)), ti.ndarray(matrix, len(states)), ti.ndarray(real, len(states))
        x.from_numpy(states.astype(precision))
        v.from_numpy(corrections.astype(precision))
        map_states(x, v, slope, SERIES_RADIUS[precision], h)
        return x.to_numpy(), h.to_numpy(), v.to_numpy()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("law", [by_warp, by_taichi])
def test_return_mapping_equals_the_reference(law, precision):
    sand = Sand(friction_angle=22, density=2000, youngs_modulus=5e7, poisson_ratio=0.3)
    scales = (1e-6, 1e-4, 1e-2, 0.05, 0.3, 1.0)
    batches = [random_gradients(seed, scale) for seed, scale in enumerate(scales)]
    # of the strain itself: an absolute bound would let all small strain be lost
    size = np.concatenate([np.full(len(part), scale) for scale, (part, _) in zip(scales, batches, strict=True)])
    gradients, corrections = (np.concatenate(parts) for parts in zip(*batches, strict=True))
    mapped, remaining = return_mapping(gradients, corrections, sand)
    left, strain, _ = hencky_strain(mapped)
    expected = (left * strain[:, None, :]) @ np.swapaxes(left, 1, 2)
    # without 1 + (F - 1) the smallest strains would be lost before the test begins
    states = gradients @ np.swapaxes(gradients, 1, 2) - np.eye(3)
    state, hencky, correction = law(states, corrections, cone_slope(sand), precision)

    # F = 1 + scale carries scale itself only to the rounding of float64 at 1, and the reference's SVD to some of that
    limit = TOLERANCE[precision] * size + 64 * np.finfo(np.float64).eps
    assert (np.abs(hencky - expected).max(axis=(1, 2)) <= limit).all()
    assert (np.abs(state - (mapped @ np.swapaxes(mapped, 1, 2) - np.eye(3))).max(axis=(1, 2)) <= limit).all()
    assert (np.abs(correction - remaining) <= limit).all()
    elastic = (mapped == gradients).all(axis=(1, 2))
    assert elastic.mean() > 0.05
    assert (remaining > 0).mean() > 0.05
    # elastic states come back bit for bit (those within rounding of the cone may fall on either side)
    same = (state == states.astype(precision)).all(axis=(1, 2))
    assert (same[elastic]).mean() > 0.99


def random_rotation(random):
    rotation, _ = np.linalg.qr(random.standard_normal((3, 3)))
    return rotation * np.sign(np.linalg.det(rotation))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    angle=st.floats(5, 60),
    ratio=st.floats(0, 0.45),
    scale=st.sampled_from([1e-4, 0.03, 0.5]),
)
def test_the_reference_law_is_idempotent_objective_and_admissible(seed, angle, ratio, scale):
    sand = Sand(friction_angle=angle, density=2000, youngs_modulus=5e7, poisson_ratio=ratio)
    gradients, corrections = random_gradients(seed, scale)
    gradients, corrections = gradients[:50], corrections[:50]
    mapped, remaining = return_mapping(gradients, corrections, sand)
    _, strain, _ = hencky_strain(mapped)
    trace = strain.sum(axis=1)
    deviator = np.linalg.norm(strain - trace[:, None] / 3, axis=1)
    # no tension, and on or inside the cone
    assert (trace <= 1e-12).all()
    assert (deviator + cone_slope(sand) * trace <= 1e-12).all()
    # volume is kept: log J of the elastic state and of the correction together are the trial's
    trial = np.log(np.linalg.det(gradients)) + corrections
    np.testing.assert_allclose(trace + remaining, trial, atol=1e-12)
    # idempotent
    again, still = return_mapping(mapped, remaining * 0, sand)
    np.testing.assert_allclose(again, mapped, atol=1e-12)
    assert (still <= 1e-12).all()
    # objective: turning the trial turns the answer
    rotation = random_rotation(np.random.default_rng(seed))
    turned, _ = return_mapping(rotation @ gradients, corrections, sand)
    left = turned @ np.swapaxes(turned, 1, 2)
    np.testing.assert_allclose(left, rotation @ mapped @ np.swapaxes(mapped, 1, 2) @ rotation.T, atol=1e-12)
