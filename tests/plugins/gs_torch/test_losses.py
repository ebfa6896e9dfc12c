"""The losses against their formulas."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.products import Camera
from slideframe_gs_torch import evaluation
from slideframe_gs_torch.anisotropy import anisotropy_loss, project_scales, share_above
from slideframe_gs_torch.harmonics import evaluate_harmonics, harmonics_basis
from slideframe_gs_torch.image_loss import image_loss, structural_similarity
from slideframe_gs_torch.views import TrainingView

# float32 against float64; SSIM's spread is a difference of squares
LOSS_TOLERANCE = 1e-5
GRADIENT_TOLERANCE = 1e-4
LIMIT = 3.0


def pictures() -> tuple[torch.Tensor, torch.Tensor]:
    random = np.random.default_rng(0)
    truth = random.uniform(0, 1, (3, 37, 53))
    return torch.tensor(np.clip(truth + 0.2 * random.normal(size=truth.shape), 0, 1)), torch.tensor(truth)


def ssim_as_written(drawn: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Wang et al. 2004, eq. 13, with an 11 x 11 window of sigma 1.5 and zeros beyond the edge."""
    offsets = torch.arange(-5, 6, dtype=torch.float64)
    bell = torch.exp(-(offsets**2) / 4.5)
    window = (torch.outer(bell, bell) / bell.sum() ** 2)[None, None].repeat(3, 1, 1, 1)

    def mean(x: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.conv2d(x[None], window, padding=5, groups=3)[0]

    m_x, m_y = mean(drawn), mean(truth)
    v_x, v_y, v_xy = mean(drawn**2) - m_x**2, mean(truth**2) - m_y**2, mean(drawn * truth) - m_x * m_y
    above = (2 * m_x * m_y + 0.01**2) * (2 * v_xy + 0.03**2)
    return (above / ((m_x**2 + m_y**2 + 0.01**2) * (v_x + v_y + 0.03**2))).mean()


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_image_loss_and_gradient_are_the_formula(weight):
    drawn, truth = pictures()
    exact_input = drawn.clone().requires_grad_()
    exact = (1 - weight) * (exact_input - truth).abs().mean() + weight * (1 - ssim_as_written(exact_input, truth))
    exact.backward()
    fast_input = drawn.float().requires_grad_()
    fast = image_loss(fast_input, truth.float(), weight)
    fast.backward()
    assert float(fast.detach()) == pytest.approx(float(exact.detach()), rel=LOSS_TOLERANCE)
    deviation = (fast_input.grad.double() - exact_input.grad).norm() / exact_input.grad.norm()
    assert deviation <= GRADIENT_TOLERANCE


def test_a_picture_is_like_itself():
    drawn, truth = pictures()
    assert structural_similarity(truth.float(), truth.float()) == pytest.approx(1.0, abs=1e-6)
    assert structural_similarity(drawn.float(), truth.float()) < 0.95


def test_anisotropy_loss_is_the_papers_equation():
    scales = torch.tensor([[1.0, 1.0, 1.0], [6.0, 2.0, 1.0], [0.3, 0.1, 0.2], [50.0, 1.0, 25.0]], dtype=torch.float64)
    by_hand = (0 + (6 - 3) + 0 + (50 - 3)) / 4
    assert anisotropy_loss(scales.log(), LIMIT).item() == pytest.approx(by_hand, rel=1e-12)


@given(st.floats(0.01, 200))
def test_anisotropy_gradient_is_finite_and_shrinks_needles(spread):
    log_scales = torch.tensor([[spread, 0.0, 0.3 * spread]], requires_grad=True)
    loss = anisotropy_loss(log_scales, LIMIT)
    loss.backward()
    assert torch.isfinite(loss)
    assert torch.isfinite(log_scales.grad).all()
    if spread > math.log(LIMIT) + 1e-3:
        assert log_scales.grad[0, 0] > 0 > log_scales.grad[0, 1]


def test_anisotropy_loss_has_no_step_at_its_bend():
    bend = math.log(100.0)
    below, above = (
        anisotropy_loss(torch.tensor([[d, 0.0, 0.0]], dtype=torch.float64), LIMIT) for d in (bend - 1e-6, bend + 1e-6)
    )
    assert (above - below) / 2e-6 == pytest.approx(100.0, rel=1e-5)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(1.1, 20))
def test_projection_keeps_the_limit_strictly_even_through_float32_logarithms(seed, limit):
    scales = np.exp(np.random.default_rng(seed).normal(-3, 2, (100, 3))).astype(np.float32)
    projected = project_scales(scales, limit)
    assert share_above(projected, limit) == 0
    assert share_above(np.exp(np.log(projected)), limit) == 0
    fitting = scales.max(axis=1) < 0.999 * limit * scales.min(axis=1)
    np.testing.assert_array_equal(projected[fitting], scales[fitting])


def test_harmonics_are_orthonormal_on_the_sphere():
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angles = np.arange(16) * math.pi / 8
    z, angle = (grid.ravel() for grid in np.meshgrid(nodes, angles, indexing="ij"))
    ring = np.sqrt(1 - z**2)
    directions = torch.tensor(np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1))
    basis = harmonics_basis(directions, 16).numpy()
    products = basis.T @ (basis * np.repeat(weights * math.pi / 8, 16)[:, None])
    np.testing.assert_allclose(products, np.eye(16), atol=1e-12)


def test_harmonics_have_the_signs_and_order_of_splat_files():
    """Constants of Kerbl et al.'s renderer at one direction."""
    x, y, z = 0.48, -0.6, 0.64
    expected = [
        0.28209479177387814, -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
        1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * z * z - x * x - y * y),
        -1.0925484305920792 * x * z, 0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3 * x * x - y * y), 2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
        0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -0.4570457994644658 * x * (4 * z * z - x * x - y * y), 1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    basis = harmonics_basis(torch.tensor([[x, y, z]], dtype=torch.float64), 16)[0]
    np.testing.assert_allclose(basis, expected, rtol=1e-12)


def test_colour_is_half_plus_harmonics_and_never_negative():
    harmonics = torch.tensor([[[1.0, 0.0, -9.0]]])
    colour = evaluate_harmonics(harmonics, torch.tensor([[0.0, 0.0, 5.0]]))[0]
    assert colour.tolist() == pytest.approx([0.5 + 0.28209479, 0.5, 0.0])


def test_what_the_lens_did_not_see_makes_no_picture_more_alike(monkeypatch):
    random = torch.Generator().manual_seed(0)
    drawn, truth = torch.rand(3, 60, 80, generator=random), torch.rand(3, 60, 80, generator=random)
    monkeypatch.setattr(evaluation, "draw_view", lambda *_: drawn)
    mask = torch.zeros(60, 80, dtype=torch.bool)
    mask[:, :40] = True
    camera = Camera(width=80, height=60, focal_x=80, focal_y=80, principal_x=40, principal_y=30)
    found = {
        name: evaluation.likeness(
            None, TrainingView(name, truth.mul(255).byte(), seen, camera, np.eye(3, 4)), (0, 0, 0)
        )
        for name, seen in (("whole", None), ("half", mask))
    }
    # noise against noise; windows that reach into the unseen half are a few pixels wide
    assert found["half"].psnr == pytest.approx(found["whole"].psnr, abs=0.3)
    assert found["half"].ssim == pytest.approx(found["whole"].ssim, abs=0.1)
