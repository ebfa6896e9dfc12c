"""The compiled rasteriser against the exact reference, and the reference against finite differences."""

import numpy as np
import pytest
import torch

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_gs_torch import threads
from slideframe_gs_torch.rasterize import Raster, rasterize

# The kernels stop a tile at a transmittance of 1e-4 and use a polynomial exp: 60 dB is 1e-3 of full scale.
FORWARD_PSNR_DB = 60.0
# float32 sums of some thousand terms against float64, relative to the largest gradient of the tensor
GRADIENT_TOLERANCE = 1e-4
# central differences of step 1e-6 in float64 lose half the digits
DIFFERENCE_TOLERANCE = 1e-5

CAMERA = Camera(width=90, height=70, focal_x=80.0, focal_y=85.0, principal_x=52.0, principal_y=30.0)
POSE = np.column_stack([np.eye(3), np.zeros(3)])
NAMES = ("centers", "rotations", "scales", "opacities", "colours")


def scene(count: int, seed: int = 0) -> list[torch.Tensor]:
    random = np.random.default_rng(seed)
    depth = random.uniform(2, 8, count)
    centers = np.column_stack(
        [random.uniform(-0.7, 0.6, count) * depth, random.uniform(-0.5, 0.6, count) * depth, depth]
    )
    arrays = [
        centers,
        random.normal(size=(count, 4)),
        np.exp(random.normal(-2.5, 0.6, (count, 3))),
        random.uniform(0.05, 0.98, count),
        random.uniform(0, 1, (count, 3)),
    ]
    return [torch.tensor(array, dtype=torch.float32).double() for array in arrays]


def with_splat(splats: list[torch.Tensor], center, scales, opacity: float = 0.9) -> list[torch.Tensor]:
    row = [center, [0.9, 0.1, -0.3, 0.2], scales, opacity, [0.9, 0.5, 0.1]]
    return [torch.cat([splats[i], torch.tensor([row[i]]).double()]) for i in range(5)]


SCENES = {
    "random": scene(400),
    "behind the camera": with_splat(scene(40), [0.1, 0.2, -3.0], [0.3, 0.3, 0.3]),
    "huge": with_splat(scene(40), [0.5, 0.1, 3.0], [4.0, 3.0, 2.0], 0.4),
    "needle": with_splat(scene(40), [0.2, 0.1, 3.0], [3.0, 0.002, 0.002]),
    "edge of the image": with_splat(scene(40), [-2.0, -1.2, 3.0], [0.4, 0.2, 0.3]),
    "far outside": with_splat(scene(40), [30.0, 2.0, 3.0], [6.0, 0.4, 0.5]),
    "many on one pixel": [torch.cat([tensor] * 60) for tensor in scene(5)],
    "one": scene(1),
}


def loss_of(raster: Raster, weights: torch.Tensor) -> torch.Tensor:
    stacked = torch.cat([raster.colour, raster.alpha[..., None]], dim=2)
    return (stacked * weights.to(stacked.dtype)).sum()


def gradients(splats, backend: str, dtype: torch.dtype) -> tuple[Raster, list[torch.Tensor]]:
    leaves = [tensor.to(dtype, copy=True).requires_grad_() for tensor in splats]
    raster = rasterize(*leaves, camera=CAMERA, world_from_camera=POSE, background=(0.2, 0.3, 0.4), backend=backend)
    weights = torch.tensor(np.random.default_rng(7).normal(size=(CAMERA.height, CAMERA.width, 4)))
    loss_of(raster, weights).backward()
    return raster, [leaf.grad for leaf in leaves]


@pytest.mark.parametrize("name", SCENES)
def test_kernels_agree_with_reference(name):
    exact, exact_gradients = gradients(SCENES[name], "torch", torch.float64)
    fast, fast_gradients = gradients(SCENES[name], "numba", torch.float32)
    error = (fast.colour.double() - exact.colour).square().mean()
    assert -10 * torch.log10(error + 1e-30) >= FORWARD_PSNR_DB
    for kind, got, expected in zip(NAMES, fast_gradients, exact_gradients, strict=True):
        assert torch.isfinite(got).all(), kind
        deviation = (got.double() - expected).norm() / expected.norm().clamp_min(1e-12)
        assert deviation <= GRADIENT_TOLERANCE, f"{kind}: {deviation:.2e}"


@pytest.mark.parametrize("which", range(5), ids=NAMES)
def test_reference_gradient_is_the_finite_difference(which):
    splats = scene(12, seed=3)
    _, exact = gradients(splats, "torch", torch.float64)
    weights = torch.tensor(np.random.default_rng(7).normal(size=(CAMERA.height, CAMERA.width, 4)))
    direction = torch.tensor(np.random.default_rng(1).normal(size=splats[which].shape)) * 1e-6

    def shifted(sign: float) -> torch.Tensor:
        moved = [tensor + sign * direction if i == which else tensor for i, tensor in enumerate(splats)]
        raster = rasterize(*moved, camera=CAMERA, world_from_camera=POSE, background=(0.2, 0.3, 0.4), backend="torch")
        return loss_of(raster, weights)

    difference = (shifted(1) - shifted(-1)) / 2
    assert difference == pytest.approx(float((exact[which] * direction).sum()), rel=DIFFERENCE_TOLERANCE)


def test_depth_is_the_distance_along_the_view_axis():
    wall = [torch.tensor([[0.0, 0.0, 4.0]]), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 2.0)]
    raster = rasterize(*wall, torch.tensor([0.95]), torch.rand(1, 3), camera=CAMERA, world_from_camera=POSE)
    assert raster.depth[30, 52] == pytest.approx(4.0, rel=1e-5)
    assert raster.alpha[30, 52] == pytest.approx(0.95, abs=1e-3)


def test_a_pixel_sees_the_splat_at_its_centre():
    """Pixel (0.5, 0.5) is the centre of the upper-left pixel."""
    x, y = ((7.5 - CAMERA.principal_x) / CAMERA.focal_x * 5, (3.5 - CAMERA.principal_y) / CAMERA.focal_y * 5)
    dot = [torch.tensor([[x, y, 5.0]]), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.01), torch.tensor([0.8])]
    raster = rasterize(*dot, torch.ones(1, 3), camera=CAMERA, world_from_camera=POSE)
    assert divmod(int(raster.alpha.argmax()), CAMERA.width) == (3, 7)
    assert raster.alpha[3, 7] == pytest.approx(0.8, abs=1e-4)


def test_any_number_of_threads_gives_the_same_bits(monkeypatch):
    monkeypatch.setattr(threads, "WORTH_THREADS", 0)
    results = []
    for count in (1, 2, 3):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        raster, found = gradients(SCENES["random"], "numba", torch.float32)
        results.append([raster.colour.detach(), *found])
    for other in results[1:]:
        assert all(torch.equal(one, two) for one, two in zip(results[0], other, strict=True))


def test_an_empty_scene_shows_the_background():
    empty = [torch.empty(0, 3), torch.empty(0, 4), torch.empty(0, 3), torch.empty(0), torch.empty(0, 3)]
    for backend in ("numba", "torch"):
        raster = rasterize(*empty, camera=CAMERA, world_from_camera=POSE, background=(0.1, 0.2, 0.3), backend=backend)
        assert torch.equal(raster.colour[5, 5], torch.tensor([0.1, 0.2, 0.3]))


def test_distortion_is_refused():
    distorted = CAMERA.model_copy(update={"distortion": (0.1, 0, 0, 0, 0)})
    with pytest.raises(InputError, match="distortion"):
        rasterize(*scene(1), camera=distorted, world_from_camera=POSE)
