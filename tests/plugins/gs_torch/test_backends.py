"""The backends for cards, as far as a machine without one can tell: Warp's on its CPU device, gsplat's by contract."""

import sys
from types import ModuleType

import numpy as np
import pytest
import torch

from slideframe.errors import InputError, MissingDependency
from slideframe.products import Camera
from slideframe_gs_torch import backends
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.reference import composite_exactly

# float32 with an exact exponential, against float64
PSNR_DB = 60.0
GRADIENT_TOLERANCE = 1e-4
CAMERA = Camera(width=60, height=45, focal_x=55.0, focal_y=50.0, principal_x=35.0, principal_y=18.0)
TURN = np.linalg.qr(np.array([[0.98, 0.05, -0.19], [-0.04, 1.0, 0.06], [0.19, -0.05, 0.98]]))[0]
POSE = np.column_stack([TURN * np.sign(np.diag(TURN)), [0.3, -0.2, -0.5]])


def scene(count: int = 60) -> list[torch.Tensor]:
    """Splats before the camera, with one behind it, a needle and a huge one, and harmonics of degree 2."""
    random = np.random.default_rng(0)
    depth = random.uniform(2, 8, count)
    centers = np.column_stack(
        [random.uniform(-0.7, 0.5, count) * depth, random.uniform(-0.4, 0.6, count) * depth, depth]
    )
    centers[0, 2] = -3.0
    scales = np.exp(random.normal(-2.0, 0.6, (count, 3)))
    scales[1], scales[2] = [2.0, 0.002, 0.002], [4.0, 3.0, 2.0]
    arrays = [
        centers,
        random.normal(size=(count, 4)),
        scales,
        random.uniform(0.05, 0.98, count),
        0.4 * random.normal(size=(count, 9, 3)),
    ]
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


def drawn(backend: str, dtype: torch.dtype, **options) -> dict[str, torch.Tensor]:
    """All there is in the raster, and the gradients of a weighted sum of it."""
    leaves = [tensor.to(dtype, copy=True).requires_grad_() for tensor in scene()]
    pose = torch.tensor(POSE, requires_grad=True)
    raster = rasterize(
        *leaves, camera=CAMERA, world_from_camera=pose, background=(0.2, 0.3, 0.4), backend=backend,
        depth=True, normals=True, **options,
    )  # fmt: skip
    planes = [raster.colour, raster.alpha[..., None], raster.depth[..., None], raster.median_depth[..., None]]
    stacked = torch.cat([*planes, raster.normals], dim=2)
    weights = torch.tensor(np.random.default_rng(7).normal(size=stacked.shape))
    (stacked * weights).sum().backward()
    names = ("centers", "rotations", "scales", "opacities", "harmonics", "pose")
    found = {name: leaf.grad.double() for name, leaf in zip(names, (*leaves, pose), strict=True)}
    return {"planes": stacked.detach().double(), **found}


def assert_as_the_reference(backend: str, **options) -> None:
    exact, found = drawn("torch", torch.float64, **options), drawn(backend, torch.float32, **options)
    error = (found.pop("planes") - exact["planes"]).square().mean() / exact.pop("planes").abs().max() ** 2
    assert -10 * torch.log10(error) >= PSNR_DB
    for name, expected in exact.items():
        deviation = (found[name] - expected).norm() / expected.norm()
        assert deviation <= GRADIENT_TOLERANCE, f"{name}: {deviation:.1e}"


@pytest.mark.parametrize("antialiased", [False, True], ids=["plain", "antialiased"])
def test_warp_draws_as_the_reference(antialiased):
    pytest.importorskip("warp")
    assert_as_the_reference("warp", antialiased=antialiased)


def test_warp_kernels_compile_for_a_card_that_is_not_there(tmp_path):
    wp = pytest.importorskip("warp")
    from slideframe_gs_torch import warp_backend, warp_kernels

    if sys.platform == "darwin":
        pytest.skip("Warp for this system has no CUDA compiler")
    warp_backend.start()
    compiled = wp.compile_aot_module(warp_kernels, arch=90, module_dir=tmp_path)
    assert [path.suffix for path in compiled] == [".cubin"]
    assert compiled[0].stat().st_size > 1000


def documented_gsplat() -> ModuleType:
    """`rasterization` as gsplat 1.5 documents it, drawn by the reference."""

    def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, **options):
        assert options["packed"] is False
        assert options["near_plane"] == 0.2
        assert options["eps2d"] == 0.3
        assert viewmats.shape == (1, 4, 4)
        assert options["backgrounds"].shape == (1, colors.shape[1])
        camera = Camera(
            width=width, height=height, focal_x=float(Ks[0, 0, 0]), focal_y=float(Ks[0, 1, 1]),
            principal_x=float(Ks[0, 0, 2]), principal_y=float(Ks[0, 1, 2]),
        )  # fmt: skip
        means, quats, scales, opacities, colors, behind, pose = (
            tensor.double()
            for tensor in (means, quats, scales, opacities, colors, options["backgrounds"][0, :3], viewmats[0, :3])
        )
        features = colors[:, 3:].reshape(len(means), -1, 3).transpose(0, 1)
        drawing = composite_exactly(
            means, quats, scales, opacities, colors[:, :3], features, behind, pose, camera,
            options["rasterize_mode"] == "antialiased", None,
        )  # fmt: skip
        planes = torch.cat([drawing.image, *drawing.planes]).permute(1, 2, 0)[None].float()
        alphas = (1 - drawing.transmittance)[None, :, :, None].float()
        return planes, alphas, {"means2d": torch.zeros(1, len(means), 2)}

    module = ModuleType("gsplat")
    module.rasterization = rasterization
    return module


@pytest.mark.parametrize("antialiased", [False, True], ids=["plain", "antialiased"])
def test_gsplat_is_handed_what_it_documents(antialiased, monkeypatch):
    pytest.importorskip("warp")
    monkeypatch.setitem(sys.modules, "gsplat", documented_gsplat())
    monkeypatch.setitem(backends.DEVICES, "gsplat", ("cpu",))
    monkeypatch.setattr(backends, "_require", lambda *_: None)
    assert_as_the_reference("gsplat", antialiased=antialiased)


def test_a_backend_that_is_not_installed_is_named_with_its_cure(monkeypatch):
    monkeypatch.setattr(backends, "find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match=r"slideframe-gs-torch\[warp\]"):
        rasterize(*scene(), camera=CAMERA, world_from_camera=POSE, backend="warp")


def test_a_backend_for_another_device_is_refused():
    with pytest.raises(InputError, match="'gsplat' can't draw tensors on 'cpu'"):
        rasterize(*scene(), camera=CAMERA, world_from_camera=POSE, backend="gsplat")


def test_a_card_without_a_compiler_draws_with_warp_and_says_why(monkeypatch, caplog):
    def lacking(device: torch.device) -> None:
        raise RuntimeError("no nvcc")

    card = torch.device("cuda")
    monkeypatch.setattr(backends, "find_spec", lambda name: object())
    monkeypatch.setattr("slideframe_gs_torch.gsplat_backend.draw_one_splat", lacking)
    backends.gsplat_works.cache_clear()
    assert backends.choose_backend(card) == "warp"
    assert "RuntimeError: no nvcc" in caplog.text
    backends.gsplat_works.cache_clear()
    monkeypatch.setattr("slideframe_gs_torch.gsplat_backend.draw_one_splat", lambda device: None)
    assert backends.choose_backend(card) == "gsplat"
    backends.gsplat_works.cache_clear()
    assert backends.choose_backend(torch.device("cpu")) == "numba"
