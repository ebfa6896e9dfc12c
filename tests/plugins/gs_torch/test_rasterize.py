"""The compiled rasteriser against the exact reference, and the reference against finite differences."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_gs_torch import compiled, threads
from slideframe_gs_torch.rasterize import Raster, rasterize
from slideframe_gs_torch.reference import camera_from

# The kernels leave a pixel at a transmittance of 1e-7 and use a polynomial exp: 60 dB is 1e-3 of full scale.
FORWARD_PSNR_DB = 60.0
# float32 sums of some thousand terms against float64, relative to the largest gradient of the tensor
GRADIENT_TOLERANCE = 1e-4
# central differences of step 1e-8 in float64 lose more than half the digits
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


def wall(opacity: float = 0.95) -> list[torch.Tensor]:
    """One wide splat 4 m ahead, thinnest along the view axis."""
    return [
        torch.tensor([[0.0, 0.0, 4.0]]), torch.tensor([[1.0, 0, 0, 0]]), torch.tensor([[2.0, 2.0, 0.1]]),
        torch.tensor([opacity]), torch.tensor([[0.9, 0.5, 0.1]]),
    ]  # fmt: skip


def pile(count: int, opacity: tuple[float, float]) -> list[torch.Tensor]:
    """Splats one behind the other, 2 to 3 m ahead."""
    random = np.random.default_rng(7)
    arrays = (
        np.column_stack([random.normal(0, 0.01, (count, 2)), random.uniform(2, 3, count)]),
        random.normal(size=(count, 4)),
        np.exp(random.normal(-2, 0.3, (count, 3))),
        random.uniform(*opacity, count),
        random.uniform(0, 1, (count, 3)),
    )
    return [torch.tensor(array, dtype=torch.float32).double() for array in arrays]


SCENES = {
    "random": scene(400),
    "behind the camera": with_splat(scene(40), [0.1, 0.2, -3.0], [0.3, 0.3, 0.3]),
    "huge": with_splat(scene(40), [0.5, 0.1, 3.0], [4.0, 3.0, 2.0], 0.4),
    "needle": with_splat(scene(40), [0.2, 0.1, 3.0], [3.0, 0.002, 0.002]),
    "edge of the image": with_splat(scene(40), [-2.0, -1.2, 3.0], [0.4, 0.2, 0.3]),
    "far outside": with_splat(scene(40), [30.0, 2.0, 3.0], [6.0, 0.4, 0.5]),
    "many on one pixel": [torch.cat([tensor] * 60) for tensor in scene(5)],
    "opaque wall": [torch.cat([one, *[other] * 5]) for one, other in zip(scene(80), wall(0.999), strict=True)],
    "one": scene(1, seed=1),
}


POSE_TURNED = np.array([[0.98, 0.05, -0.19, 0.3], [-0.04, 1.0, 0.06, -0.2], [0.19, -0.05, 0.98, -0.5]])
POSE_TURNED[:, :3] = np.linalg.qr(POSE_TURNED[:, :3])[0] * np.sign(np.diag(np.linalg.qr(POSE_TURNED[:, :3])[1]))
BACKGROUND = (0.2, 0.3, 0.4)


def loss_of(raster: Raster) -> torch.Tensor:
    """A weighted sum of all there is in a raster."""
    parts = [raster.colour, raster.alpha[..., None]]
    if raster.depth is not None:
        parts += [raster.depth[..., None], raster.median_depth[..., None]]
    if raster.normals is not None:
        parts.append(raster.normals)
    stacked = torch.cat(parts, dim=2)
    weights = torch.tensor(np.random.default_rng(7).normal(size=stacked.shape), dtype=stacked.dtype)
    return (stacked * weights).sum()


def gradients(splats, backend: str, dtype: torch.dtype, **options) -> tuple[Raster, list[torch.Tensor]]:
    """The gradients of the five tensors, the pose and the background."""
    leaves = [tensor.to(dtype, copy=True).requires_grad_() for tensor in splats]
    pose = torch.tensor(options.pop("pose", POSE), dtype=torch.float64, requires_grad=True)
    background = torch.tensor(BACKGROUND, dtype=dtype, requires_grad=True)
    camera = options.pop("camera", CAMERA)
    raster = rasterize(
        *leaves, camera=camera, world_from_camera=pose, background=background, backend=backend, **options
    )
    loss_of(raster).backward()
    return raster, [leaf.grad for leaf in (*leaves, pose, background)]


def assert_alike(splats, backend: str = "numba", **options) -> None:
    exact, exact_gradients = gradients(splats, "torch", torch.float64, **options)
    fast, fast_gradients = gradients(splats, backend, torch.float32, **options)
    for plane in ("colour", "alpha", "depth", "median_depth", "normals"):
        expected, got = getattr(exact, plane), getattr(fast, plane)
        if expected is not None:
            error = (got.detach().double() - expected.detach()).square().mean()
            peak = expected.detach().abs().max().clamp_min(1)
            assert 20 * torch.log10(peak) - 10 * torch.log10(error + 1e-30) >= FORWARD_PSNR_DB, plane
    for kind, got, expected in zip((*NAMES, "pose", "background"), fast_gradients, exact_gradients, strict=True):
        assert torch.isfinite(got).all(), kind
        deviation = (got.double() - expected).norm() / expected.norm().clamp_min(1e-12)
        assert deviation <= GRADIENT_TOLERANCE, f"{kind}: {deviation:.2e}"


@pytest.mark.parametrize("name", SCENES)
def test_kernels_agree_with_reference(name):
    assert_alike(SCENES[name])


def with_harmonics(splats: list[torch.Tensor], degree: int) -> list[torch.Tensor]:
    random = np.random.default_rng(degree)
    coefficients = 0.4 * random.normal(size=(len(splats[0]), (degree + 1) ** 2, 3))
    return [*splats[:4], torch.tensor(coefficients, dtype=torch.float32).double()]


@pytest.mark.parametrize("degree", range(4))
def test_harmonics_agree_with_reference(degree):
    assert_alike(with_harmonics(scene(60, seed=2), degree), pose=POSE_TURNED)


def test_harmonics_turn_with_the_ground():
    frames = np.linalg.qr(np.random.default_rng(5).normal(size=(60, 3, 3)))[0].astype(np.float32)
    assert_alike(with_harmonics(scene(60, seed=2), 3), frame_rotations=frames)


@pytest.mark.parametrize("name", SCENES)
def test_anti_aliasing_agrees_with_reference(name):
    assert_alike(SCENES[name], antialiased=True)


def test_depth_and_normals_agree_with_reference():
    assert_alike(with_harmonics(scene(80, seed=4), 1), pose=POSE_TURNED, depth=True, normals=True)


@pytest.mark.parametrize("name", SCENES)
def test_the_kernels_pose_gradient_is_the_exact_finite_difference(name):
    """Twelve numbers moved at once, in float64 by the reference, against the float32 gradient of the kernels."""
    *_, gradient, _ = gradients(SCENES[name], "numba", torch.float32)[1]
    direction = np.random.default_rng(1).normal(size=(3, 4))
    direction /= np.linalg.norm(direction)
    ahead, behind = (
        float(
            loss_of(
                rasterize(
                    *SCENES[name],
                    camera=CAMERA,
                    world_from_camera=POSE + sign * 1e-8 * direction,
                    background=BACKGROUND,
                    backend="torch",
                )
            )
        )
        for sign in (1, -1)
    )
    difference = (ahead - behind) / 2e-8
    assert difference == pytest.approx(float((gradient.numpy() * direction).sum()), abs=1e-4 * float(gradient.norm()))


@pytest.mark.parametrize("which", range(7), ids=(*NAMES, "pose", "background"))
@pytest.mark.parametrize("antialiased", [False, True], ids=["plain", "antialiased"])
def test_reference_gradient_is_the_finite_difference(which, antialiased):
    options = {"depth": True, "normals": True, "antialiased": antialiased}
    inputs = [*with_harmonics(scene(12, seed=3), 3), torch.tensor(POSE_TURNED), torch.tensor(BACKGROUND).double()]
    leaves = [tensor.clone().requires_grad_() for tensor in inputs]

    def loss(*tensors: torch.Tensor) -> torch.Tensor:
        *splats, pose, background = tensors
        return loss_of(
            rasterize(*splats, camera=CAMERA, world_from_camera=pose, background=background, backend="torch", **options)
        )

    loss(*leaves).backward()
    # so small a step that no pixel crosses the threshold of alpha
    direction = torch.tensor(np.random.default_rng(1).normal(size=inputs[which].shape)) * 1e-8
    shifted = [
        [tensor + sign * direction if i == which else tensor for i, tensor in enumerate(inputs)] for sign in (1, -1)
    ]
    difference = (loss(*shifted[0]) - loss(*shifted[1])) / 2
    assert difference == pytest.approx(float((leaves[which].grad * direction).sum()), rel=DIFFERENCE_TOLERANCE)


def test_depth_is_the_distance_along_the_view_axis_and_normals_look_back():
    raster = rasterize(*wall(), camera=CAMERA, world_from_camera=POSE, depth=True, normals=True)
    assert raster.depth[30, 52] == pytest.approx(4.0, rel=1e-5)
    assert raster.median_depth[30, 52] == pytest.approx(4.0, rel=1e-5)
    assert raster.alpha[30, 52] == pytest.approx(0.95, abs=1e-3)
    assert raster.normals[30, 52].tolist() == pytest.approx([0, 0, -1], abs=1e-5)


def test_median_depth_is_that_of_the_splat_that_takes_half_the_light():
    splats = [torch.cat([tensor] * 3) for tensor in wall()]
    splats[0][:, 2] = torch.tensor([4.0, 2.0, 3.0])
    splats[3] = torch.tensor([0.9, 0.3, 0.4])
    raster = rasterize(*splats, camera=CAMERA, world_from_camera=POSE, depth=True)
    # light left behind them, near to far: 0.7, 0.42, 0.04
    assert raster.median_depth[30, 52] == pytest.approx(3.0, rel=1e-5)
    splats[3] = torch.tensor([0.1, 0.1, 0.1])
    assert rasterize(*splats, camera=CAMERA, world_from_camera=POSE, depth=True).median_depth[30, 52] == 0


def test_a_small_splat_keeps_its_light_with_anti_aliasing():
    """What a splat far below a pixel sends is its own opacity times its own area, at any distance."""
    light = []
    for distance in (20.0, 40.0):
        dot = [torch.tensor([[0.0, 0.0, distance]]), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.05)]
        raster = rasterize(
            *dot, torch.tensor([0.9]), torch.ones(1, 3), camera=CAMERA, world_from_camera=POSE, antialiased=True
        )
        sigma = 0.05 * np.sqrt(CAMERA.focal_x * CAMERA.focal_y) / distance
        light.append(float(raster.alpha.sum()) / (0.9 * 2 * np.pi * sigma**2))
    # what lies below alpha 1/255 is cut off
    assert light == pytest.approx([1.0, 1.0], abs=0.15)


def test_tensors_that_do_not_fit_are_refused():
    splats = scene(3)
    with pytest.raises(InputError, match=r"'scales' has shape \(2, 3\)"):
        rasterize(*splats[:2], splats[2][:2], *splats[3:], camera=CAMERA, world_from_camera=POSE)
    with pytest.raises(InputError, match="harmonics of degree 0 to 3"):
        rasterize(*splats[:4], torch.zeros(3, 5, 3), camera=CAMERA, world_from_camera=POSE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"background": (0.5,)}, r"'background' has shape \(1,\)"),
        ({"world_from_camera": np.eye(4)}, r"'world_from_camera' has shape \(4, 4\)"),
        ({"world_from_camera": 2 * POSE}, "doesn't begin with a rotation"),
        ({"world_from_camera": np.nan * POSE}, "doesn't begin with a rotation"),
        ({"frame_rotations": np.zeros((2, 3, 3), np.float32)}, r"'frame_rotations' has shape \(2, 3, 3\)"),
        ({"screen_gradients": torch.zeros(2, 2)}, r"'screen_gradients' has shape \(2, 2\)"),
        ({"backend": "vulkan"}, "no backend 'vulkan'"),
    ],
)
def test_a_view_that_does_not_fit_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        rasterize(*scene(3), **({"camera": CAMERA, "world_from_camera": POSE} | options))


def test_a_pixel_sees_the_splat_at_its_centre():
    """Pixel (0.5, 0.5) is the centre of the upper-left pixel."""
    x, y = ((7.5 - CAMERA.principal_x) / CAMERA.focal_x * 5, (3.5 - CAMERA.principal_y) / CAMERA.focal_y * 5)
    dot = [torch.tensor([[x, y, 5.0]]), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.01), torch.tensor([0.8])]
    raster = rasterize(*dot, torch.ones(1, 3), camera=CAMERA, world_from_camera=POSE)
    assert divmod(int(raster.alpha.argmax()), CAMERA.width) == (3, 7)
    assert raster.alpha[3, 7] == pytest.approx(0.8, abs=1e-4)


@pytest.mark.parametrize("backend", ["numba", "warp"])
@pytest.mark.parametrize(
    ("count", "opacity"), [(100_000, (0.01, 0.9)), (10_000, (0.02, 0.02))], ids=["100000", "faint"]
)
def test_splats_on_one_pixel_agree_with_reference(count, opacity, backend):
    pytest.importorskip(backend)
    tiny = Camera(width=5, height=4, focal_x=4, focal_y=4, principal_x=2.5, principal_y=2)
    assert_alike(pile(count, opacity), backend, camera=tiny)


# three blocks of projection; three runs of binning
@pytest.mark.parametrize("count", [600, 20_000])
def test_any_number_of_threads_gives_the_same_bits(count, monkeypatch):
    monkeypatch.setattr(threads, "WORTH_THREADS", 0)
    splats = with_harmonics(scene(count), 2)
    results = []
    for number in (1, 2, 3):
        monkeypatch.setattr(threads, "thread_count", lambda number=number: number)
        raster, found = gradients(splats, "numba", torch.float32, pose=POSE_TURNED, depth=True, normals=True)
        planes = [raster.colour, raster.alpha, raster.depth, raster.median_depth, raster.normals]
        results.append([*(plane.detach() for plane in planes), *found])
    for other in results[1:]:
        assert all(torch.equal(one, two) for one, two in zip(results[0], other, strict=True))


@given(seed=st.integers(0, 1000), spread=st.floats(-5, 3))
@settings(max_examples=40, deadline=None)
def test_what_a_view_shows_is_among_what_it_may_show(seed, spread):
    splats = [tensor.float().numpy() for tensor in scene(300, seed)]
    random = np.random.default_rng(seed)
    splats[0] = (splats[0] + random.normal(0, 4, (300, 3))).astype(np.float32)  # also behind the camera and beside it
    splats[2] = (splats[2] * np.exp(random.normal(spread, 1, (300, 3)))).astype(np.float32)
    view = compiled.View.of(CAMERA, camera_from(torch.tensor(POSE_TURNED)).numpy())
    drawn = compiled.draw(compiled.Splats(*splats), view, np.zeros(3, np.float32)).lists.order
    may = compiled.in_view(splats[0], np.log(splats[2]), view)
    assert set(drawn.tolist()) <= set(may.tolist())
    assert len(may) < 300


def test_an_empty_scene_shows_the_background():
    empty = [torch.empty(0, 3), torch.empty(0, 4), torch.empty(0, 3), torch.empty(0), torch.empty(0, 3)]
    for backend in ("numba", "torch"):
        raster = rasterize(*empty, camera=CAMERA, world_from_camera=POSE, background=(0.1, 0.2, 0.3), backend=backend)
        assert torch.equal(raster.colour[5, 5], torch.tensor([0.1, 0.2, 0.3]))


def test_distortion_is_refused():
    distorted = CAMERA.model_copy(update={"distortion": (0.1, 0, 0, 0, 0)})
    with pytest.raises(InputError, match="distortion"):
        rasterize(*scene(1), camera=distorted, world_from_camera=POSE)
