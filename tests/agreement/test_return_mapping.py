"""Pointwise: both backends' return mapping against the float64 reference on random deformation gradients."""

from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.device import Device
from slideframe.problem import LAWS, DruckerPrager, Elastic, Sand
from slideframe.reference.constitutive import hencky_strain, return_mapping
from slideframe.stress import symmetric

# physics.md: 1e-5 and 1e-10. b = F F^T has the square of F's condition, so the strain of a particle
# crushed in one direction has lost that much of float32 already in its state.
TOLERANCE = {"float32": 1e-5, "float64": 1e-10}
BATCH = 4000
STIFFNESS = {"density": 2000, "youngs_modulus": 5e7, "poisson_ratio": 0.3}
# c, cut-off and stiffness put the tip of the surface at strains that the batches reach
EARTH = {"kind": "drucker_prager", "friction_angle": 30, "cohesion": 5e5, "dilatancy_angle": 10} | STIFFNESS
MATERIALS = {
    "elastic": Elastic(**STIFFNESS),
    "sand": Sand(friction_angle=22, **STIFFNESS),
    "sand, pyramid": Sand(friction_angle=30, friction_match="mohr_coulomb", **STIFFNESS),
    "sand that forgets expansion": Sand(friction_angle=30, volume_correction=False, **STIFFNESS),
    "cone": DruckerPrager(**EARTH, friction_match="plane_strain"),
    "cone, cut off": DruckerPrager(**EARTH, friction_match="triaxial_extension", tension_cutoff=3e5),
    "pyramid": DruckerPrager(**EARTH, friction_match="mohr_coulomb"),
    "pyramid, cut off": DruckerPrager(**EARTH, friction_match="mohr_coulomb", tension_cutoff=3e5),
}


def random_gradients(seed, scale):
    """Deformation gradients from tiny to large strain, sheared, stretched and crushed up to a condition of 10."""
    random = np.random.default_rng(seed)
    gradients = np.eye(3) + scale * random.uniform(-1, 1, (BATCH, 3, 3))
    gradients -= scale * random.uniform(0, 0.7, (BATCH, 1, 1)) * np.eye(3)
    sound = (np.linalg.det(gradients) > 0.02) & (np.linalg.cond(gradients) < 10)
    gradients = gradients[sound]
    corrections = np.where(random.random(len(gradients)) < 0.5, 0, scale * random.uniform(0, 0.3, len(gradients)))
    return gradients, corrections


def degenerate_gradients(scale):
    """Gradients with two or three equal principal stretches, along the axes and turned: eigenvectors are anybody's."""
    random = np.random.default_rng(17)
    pairs = np.exp(scale * random.uniform(-1, 1, (60, 2)))
    stretches = np.concatenate([pairs[:, [0, 0, 1]], pairs[:, [0, 1, 0]], np.repeat(pairs[:, :1], 3, axis=1)])
    plain = stretches[:, :, None] * np.eye(3)
    turned = np.array([random_rotation(random) for _ in plain]) @ plain
    gradients = np.concatenate([plain, turned])
    return gradients, np.where(random.random(len(gradients)) < 0.5, 0, 0.1 * scale)


@contextmanager
def warp_law(precision):
    """Give Warp's return mapping of arrays of states and corrections, compiled once."""
    import warp as wp

    from slideframe_mpm_warp.runtime import kernels_in
    from slideframe_mpm_warp.stepper import JACOBI_SWEEPS

    kernels = kernels_in(precision, "cpu", False, False)
    level, wp.config.log_level = wp.config.log_level, wp.LOG_ERROR

    @wp.kernel(module="unique", enable_backward=False)
    def map_states(
        states: wp.array(dtype=kernels.Matrix),
        corrections: wp.array(dtype=kernels.Real),
        law: int,
        constants: kernels.Soil,
        sweeps: int,
        strains: wp.array(dtype=kernels.Matrix),
        sheared: wp.array(dtype=kernels.Real),
    ):
        particle = wp.tid()
        state, strain, correction, shear = kernels.return_mapping(
            law, states[particle], corrections[particle], constants, sweeps
        )
        states[particle] = state
        strains[particle] = strain
        corrections[particle] = correction
        sheared[particle] = shear

    def apply(states, corrections, soil):
        with wp.ScopedDevice("cpu"):
            x = wp.array(states.astype(precision), dtype=kernels.Matrix)
            v = wp.array(corrections.astype(precision), dtype=kernels.Real)
            h = wp.zeros(len(states), dtype=kernels.Matrix)
            s = wp.zeros(len(states), dtype=kernels.Real)
            law, constants = LAWS.index(soil.law), kernels.Soil(*soil.constants)
            wp.launch(map_states, dim=len(states), inputs=[x, v, law, constants, JACOBI_SWEEPS, h, s])
        return x.numpy().copy(), h.numpy().copy(), v.numpy().copy(), s.numpy().copy()

    yield apply
    wp.config.log_level = level


def packed(states):
    """Give the six components of symmetric matrices (n, 3, 3) in the solvers' order."""
    return states[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]


@contextmanager
def warp_lanes(precision):
    """Give the same law through the kernel that strains many particles at once, here by nothing."""
    import warp as wp

    from slideframe_mpm_warp.runtime import kernels_in
    from slideframe_mpm_warp.stepper import JACOBI_SWEEPS

    kernels = kernels_in(precision, "cpu", False, False)

    def apply(states, corrections, soil):
        count = len(states)
        with wp.ScopedDevice("cpu"):
            x = wp.array(packed(states).astype(precision), dtype=kernels.Vector6)
            v = wp.array(corrections.astype(precision), dtype=kernels.Real)
            s, ones = wp.zeros(count, dtype=kernels.Real), wp.ones(count, dtype=kernels.Real)
            affines, frames = wp.zeros(count, dtype=kernels.Matrix), wp.zeros(count, dtype=kernels.Matrix)
            constants = [1.0, 1.0, LAWS.index(soil.law), kernels.Soil(*soil.constants), JACOBI_SWEEPS]
            inputs = [0, count, affines, affines, x, v, s, frames, ones, ones, *constants]
            wp.launch(kernels.strain_particles, dim=-(-count // int(kernels.LANES)), inputs=inputs)
        # what is left in `affines` is -(2 mu h + lambda tr(h) 1)
        pull = -affines.numpy().astype(np.float64)
        trace = np.trace(pull, axis1=1, axis2=2) / (2 * soil.shear_modulus + 3 * soil.lame_lambda)
        h = (pull - soil.lame_lambda * trace[:, None, None] * np.eye(3)) / (2 * soil.shear_modulus)
        return symmetric(x.numpy()), h, v.numpy().copy(), s.numpy().copy()

    yield apply


@contextmanager
def taichi_law(precision):
    """Give Taichi's return mapping of arrays of states and corrections, compiled once for each law."""
    from slideframe_mpm_taichi.runtime import session
    from slideframe_mpm_taichi.stepper import SERIES_RADIUS

    with session(Device(), precision):
        import taichi as ti

        from slideframe_mpm_taichi.kernels import return_mapping as mapping

        @ti.kernel
        def map_states(
            states: ti.types.ndarray(),
            corrections: ti.types.ndarray(),
            soils: ti.types.ndarray(),
            radius: float,
            strains: ti.types.ndarray(),
            sheared: ti.types.ndarray(),
            law: ti.template(),
        ):
            for particle in range(states.shape[0]):
                state, strain, correction, shear = mapping(
                    law, states[particle], corrections[particle], soils[0], radius
                )
                states[particle] = state
                strains[particle] = strain
                corrections[particle] = correction
                sheared[particle] = shear

        def apply(states, corrections, soil):
            real = ti.f64 if precision == "float64" else ti.f32
            state = ti.types.vector(6, real)
            x, h, v = ti.ndarray(state, len(states)), ti.ndarray(state, len(states)), ti.ndarray(real, len(states))
            s, soils = ti.ndarray(real, len(states)), ti.ndarray(ti.types.vector(len(soil.constants), real), 1)
            soils.from_numpy(np.array([soil.constants], precision))
            x.from_numpy(packed(states).astype(precision))
            v.from_numpy(corrections.astype(precision))
            map_states(x, v, soils, SERIES_RADIUS[precision], h, s, LAWS.index(soil.law))
            return symmetric(x.to_numpy()), symmetric(h.to_numpy()), v.to_numpy(), s.to_numpy()

        yield apply


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("backend", [warp_law, warp_lanes, taichi_law])
def test_return_mapping_equals_the_reference(backend, precision):
    with backend(precision) as law:
        for material, soil in MATERIALS.items():
            assert_law_equals_the_reference(law, precision, material, soil)


def assert_law_equals_the_reference(law, precision, material, soil):
    scales = (1e-6, 1e-4, 1e-2, 0.05, 0.3, 1.0)
    batches = [random_gradients(seed, scale) for seed, scale in enumerate(scales)]
    # of the strain itself: an absolute bound would let all small strain be lost
    scales += (1e-5, 1e-3, 0.1)
    batches += [degenerate_gradients(scale) for scale in scales[-3:]]
    size = np.concatenate([np.full(len(part), scale) for scale, (part, _) in zip(scales, batches, strict=True)])
    gradients, corrections = (np.concatenate(parts) for parts in zip(*batches, strict=True))
    mapped, remaining, sheared = return_mapping(gradients, corrections, soil)
    left, strain, _ = hencky_strain(mapped)
    expected = (left * strain[:, None, :]) @ np.swapaxes(left, 1, 2)
    # without 1 + (F - 1) the smallest strains would be lost before the test begins
    states = gradients @ np.swapaxes(gradients, 1, 2) - np.eye(3)
    state, hencky, correction, shear = law(states, corrections, soil)

    # F = 1 + scale carries scale itself only to the rounding of float64 at 1, and the reference's SVD to some of that
    limit = TOLERANCE[precision] * size + 64 * np.finfo(np.float64).eps
    assert (np.abs(hencky - expected).max(axis=(1, 2)) <= limit).all(), material
    assert (np.abs(state - (mapped @ np.swapaxes(mapped, 1, 2) - np.eye(3))).max(axis=(1, 2)) <= limit).all(), material
    assert (np.abs(correction - remaining) <= limit).all(), material
    assert (np.abs(shear - sheared) <= limit).all(), material
    elastic = (mapped == gradients).all(axis=(1, 2))
    assert elastic.mean() > 0.05, material
    if soil.law != "elastic":
        assert (sheared > 0).mean() > 0.05, material
        assert (remaining > corrections).mean() > 0.05 or not soil.volume_correction, material
    # elastic states come back bit for bit (those within rounding of the cone may fall on either side)
    same = (state == states.astype(precision)).all(axis=(1, 2))
    assert (same[elastic]).mean() > 0.99, material


def random_rotation(random):
    rotation, _ = np.linalg.qr(random.standard_normal((3, 3)))
    return rotation * np.sign(np.linalg.det(rotation))


SOILS = st.builds(
    lambda angle, ratio, match, cohesion, dilatancy, cutoff: DruckerPrager(
        friction_angle=angle,
        friction_match=match,
        cohesion=cohesion,
        dilatancy_angle=dilatancy * angle,
        tension_cutoff=cutoff,
        **STIFFNESS | {"poisson_ratio": ratio},
    ),
    angle=st.floats(5, 60),
    ratio=st.floats(0, 0.45),
    match=st.sampled_from(["triaxial_compression", "triaxial_extension", "plane_strain", "mohr_coulomb"]),
    cohesion=st.sampled_from([0.0, 1e4, 1e6]),
    dilatancy=st.floats(0, 1),
    cutoff=st.sampled_from([None, 0.0, 2e5]),
)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), soil=SOILS, scale=st.sampled_from([1e-4, 0.03, 0.5]))
def test_the_reference_laws_are_idempotent_objective_and_admissible(seed, soil, scale):
    gradients, corrections = random_gradients(seed, scale)
    gradients, corrections = gradients[:50], corrections[:50]
    mapped, remaining, sheared = return_mapping(gradients, corrections, soil)
    assert (yield_function(mapped, soil) <= 1e-12).all()
    assert (remaining >= 0).all()
    assert (sheared >= 0).all()
    # idempotent
    again, still, _ = return_mapping(mapped, remaining * 0, soil)
    np.testing.assert_allclose(left_tensor(again), left_tensor(mapped), atol=1e-12)
    assert (still <= 1e-12).all()
    # objective: turning the trial turns the answer
    rotation = random_rotation(np.random.default_rng(seed))
    turned = return_mapping(rotation @ gradients, corrections, soil).elastic
    np.testing.assert_allclose(left_tensor(turned), rotation @ left_tensor(mapped) @ rotation.T, atol=1e-12)


def left_tensor(gradients):
    """b = F F^T, which alone decides the stress: where strain vanishes the rotation in F is anybody's."""
    return gradients @ np.swapaxes(gradients, 1, 2)


def yield_function(elastic, soil):
    """How far, in strain, states lie beyond the yield surface; Mohr-Coulomb's from its textbook form."""
    _, strain, _ = hencky_strain(elastic)
    trace = strain.sum(axis=1)
    constants = soil.constants
    if soil.law == "drucker_prager":
        deviator = np.linalg.norm(strain - trace[:, None] / 3, axis=1)
        return np.maximum(deviator + constants.cone_slope * (trace - constants.apex), trace - constants.cutoff)
    stress = 2 * soil.shear_modulus * strain + soil.lame_lambda * trace[:, None]
    sine, cosine = np.sin(np.radians(soil.friction_angle)), np.cos(np.radians(soil.friction_angle))
    slip = stress[:, 0] - stress[:, 2] + (stress[:, 0] + stress[:, 2]) * sine - 2 * soil.cohesion * cosine
    tension = stress[:, 0] - (np.inf if soil.tension_cutoff is None else soil.tension_cutoff)
    return np.maximum(slip, tension) / (2 * soil.shear_modulus)


def test_plastic_strain_flows_as_the_dilatancy_angle_says():
    """On one plane of the pyramid the plastic strain is (1 + sin psi, 0, sin psi - 1) times a multiplier."""
    soil = DruckerPrager(friction_angle=35, dilatancy_angle=12, friction_match="mohr_coulomb", **STIFFNESS)
    trial = np.diag(np.exp([0.006, -0.004, -0.016]))[None]
    _, strain, _ = hencky_strain(return_mapping(trial, np.zeros(1), soil).elastic)
    plastic = np.array([0.006, -0.004, -0.016]) - strain[0]
    sine = np.sin(np.radians(12))
    np.testing.assert_allclose(plastic / plastic[0], [1, 0, (sine - 1) / (1 + sine)], atol=1e-12)


@pytest.mark.parametrize("match", ["triaxial_compression", "triaxial_extension", "plane_strain"])
def test_associated_cone_finds_the_nearest_point(match):
    """With psi = phi the return is the projection in the energy norm: no other admissible state is nearer."""
    soil = DruckerPrager(friction_angle=30, dilatancy_angle=30, cohesion=1e5, friction_match=match, **STIFFNESS)
    trial = np.array([0.003, 0.001, -0.006])
    _, strain, _ = hencky_strain(return_mapping(np.diag(np.exp(trial))[None], np.zeros(1), soil).elastic)
    stiffness = 2 * soil.shear_modulus * np.eye(3) + soil.lame_lambda
    others = strain[0] + 1e-3 * np.random.default_rng(5).standard_normal((4000, 3))
    norm = np.linalg.norm(others - others.mean(axis=1, keepdims=True), axis=1)
    admissible = others[norm + soil.constants.cone_slope * (others.sum(axis=1) - soil.constants.apex) <= 0]
    distance = [float(way @ stiffness @ way) for way in (trial - admissible)]
    best = trial - strain[0]
    assert len(admissible) > 500
    assert best @ stiffness @ best <= min(distance) * (1 + 1e-12)
