"""Depths of sparse points, floaters before cameras, and photographs of different exposure."""

import numpy as np
import pytest
import torch

from slideframe.products import Camera
from slideframe_gs_torch.depth_points import depth_points
from slideframe_gs_torch.exposure import Exposures, fitted
from slideframe_gs_torch.training import active_degree, fade_near

CAMERA = Camera(width=64, height=48, focal_x=50.0, focal_y=50.0, principal_x=32.0, principal_y=24.0)
POSE = np.column_stack([np.eye(3), [0, 0, -10.0]])


def test_points_are_projected_and_hidden_ones_left_out():
    points = np.float32([[0, 0, 0], [0.1, 0.1, 40], [4, 3, 0], [0, 0, -20], [99, 0, 0]])
    found = depth_points(points, CAMERA, POSE)
    assert found.depths.tolist() == pytest.approx([10, 10])
    assert sorted(zip(found.rows.tolist(), found.columns.tolist(), strict=True)) == [(24, 32), (39, 52)]
    assert depth_points(points[3:], CAMERA, POSE) is None


def test_a_depth_that_is_off_costs_and_pulls_back():
    found = depth_points(np.float32([[0, 0, 0]]), CAMERA, POSE)
    alpha = torch.ones(48, 64)
    exact = torch.full((48, 64), 10.0)
    far = torch.full((48, 64), 11.0, requires_grad=True)
    assert float(found.loss(exact, alpha)) == 0
    loss = found.loss(far, alpha)
    loss.backward()
    assert float(loss) > 0
    assert far.grad[24, 32] > 0
    assert float(found.loss(far, torch.zeros(48, 64))) == 0


def test_splats_that_hang_before_a_camera_become_invisible():
    raw = {"centers": torch.tensor([[0.0, 0, 1], [0, 0, 9], [50, 0, 0]]), "logits": torch.zeros(3)}
    fade_near(raw, torch.tensor([[0.0, 0, 0]]), nearest=2.0)
    assert (raw["logits"].sigmoid() > 0.1).tolist() == [False, True, True]


def test_an_exposure_is_learned_and_the_others_stay():
    random = torch.Generator().manual_seed(0)
    scene = torch.rand(3, 20, 20, generator=random)
    truth = scene * torch.tensor([1.2, 0.9, 1.0])[:, None, None] + 0.05
    exposures = Exposures.of(3)
    for _ in range(400):
        correction = exposures.corrections[1].clone().requires_grad_()
        loss = (exposures.correct(scene, correction) - truth).abs().mean() + exposures.regularisation(correction)
        loss.backward()
        exposures.step(1, correction.grad)
    assert (exposures.correct(scene, exposures.corrections[1]) - truth).abs().mean() < 0.01
    assert exposures.corrections[[0, 2]].tolist() == [[[1, 0]] * 3] * 2


def test_the_fitted_exposure_takes_all_of_a_gain_and_an_offset_off():
    scene = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(1)) * 0.5 + 0.2
    mask = torch.ones(20, 20, dtype=torch.bool)
    mask[:5] = False
    other = 0.8 * scene + 0.1
    other[:, :5] = 7.0
    assert torch.allclose(fitted(other, scene, mask)[:, 5:], scene[:, 5:], atol=1e-6)


def test_colours_depend_on_the_view_bit_by_bit():
    assert [active_degree(3, share) for share in (0.0, 0.05, 0.1, 0.25, 0.31, 1.0)] == [0, 0, 1, 2, 3, 3]
    assert active_degree(1, 0.9) == 1
