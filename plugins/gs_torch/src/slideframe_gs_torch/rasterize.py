"""The differentiable rasteriser: splats in, a picture out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from slideframe.arrays import Float32Array, Float64Array
from slideframe.errors import InputError
from slideframe.products import Camera
from slideframe_gs_torch.backends import Backend, choose_backend, draw_with
from slideframe_gs_torch.reference import PlaneDrawing, camera_from, rotation_matrices

__all__ = ["Raster", "rasterize"]

# Below this alpha a pixel is taken to see nothing, and means over the splats seen are 0.
LEAST_ALPHA = 1e-6
# By how much the entries of R R^T may be off: files round, and refinements drift.
POSE_TOLERANCE = 1e-2


@dataclass(frozen=True)
class Raster:
    """A rasterised view.

    Attributes:
        colour: (height, width, 3), over the background.
        alpha: (height, width), 0 where only the background is seen.
        depth: (height, width), m along the view axis, the mean over the splats seen, each weighted with its share of
            the light; 0 where there is none. None if not asked for, like those that follow.
        median_depth: (height, width), m, of the splat behind which less than half of the light is left; 0 where
            more than half comes from the background. Its gradient is that of this splat's depth.
        normals: (height, width, 3), world axes, the mean of the splats' normals; shorter than 1 where they disagree.
            A splat's normal is its shortest axis, turned to the camera.
    """

    colour: Tensor
    alpha: Tensor
    depth: Tensor | None = None
    median_depth: Tensor | None = None
    normals: Tensor | None = None

    @classmethod
    def of(cls, drawing: PlaneDrawing, depths: Tensor | None, normals: bool) -> Self:
        """Turn what was drawn, weighted sums, into means; of depths (splat,) as well where they are given."""
        alpha = 1 - drawing.transmittance
        seen = alpha.clamp_min(LEAST_ALPHA)
        return cls(
            drawing.image.permute(1, 2, 0),
            alpha,
            None if depths is None else drawing.planes[0, 0] / seen,
            None if depths is None else _median_depth(depths, drawing.median),
            (drawing.planes[-1] / seen).permute(1, 2, 0) if normals else None,
        )


def rasterize(
    centers: Tensor,
    rotations: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colours: Tensor,
    *,
    camera: Camera,
    world_from_camera: Float64Array | Tensor,
    background: Sequence[float] | Tensor = (0.0, 0.0, 0.0),
    antialiased: bool = False,
    depth: bool = False,
    normals: bool = False,
    frame_rotations: Float32Array | None = None,
    backend: Backend | None = None,
    screen_gradients: Tensor | None = None,
) -> Raster:
    """Draw splats as a pinhole camera sees them (Kerbl et al. 2023).

    Differentiable in the five tensors, in `world_from_camera` and in `background`, where they are tensors that
    require it; the pose's gradient is that of its twelve numbers, whatever keeps them a pose. Depth and normals cost
    about as much as the colours, each.

    Args:
        centers: (splat, 3), m.
        rotations: (splat, 4), quaternions wxyz, normalised here.
        scales: (splat, 3), standard deviations, m.
        opacities: (splat,), 0 to 1.
        colours: (splat, 3) as seen from this camera, or spherical harmonics (splat, 1, 4, 9 or 16, 3), of which the
            colour is 0.5 + basis . coefficients, not below 0.
        camera: without distortion; its principal point may lie anywhere.
        world_from_camera: (3, 4), m.
        background: (3,), colour where no splat is.
        antialiased: take off the opacity that the low-pass of 0.3 px^2 adds to splats below the size of a pixel
            (Yu et al. 2024).
        depth: whether to give depth and median depth.
        normals: whether to give normals.
        frame_rotations: (splat, 3, 3), from the frame of each splat's harmonics to the world, where the splat has
            turned since they were made; no gradient.
        backend: none: by the tensors' device. `numba` (CPU) is compiled, float32, and gives the same bits for any
            number of threads; `gsplat` (CUDA) wants a compiler, `warp` (CUDA) a driver only; `torch` (CPU) is the
            reference: slow, exact, and of any precision.
        screen_gradients: (splat, 2), filled in the backward pass with the sum over tiles (`numba`) or pixels
            (`gsplat`, `warp`) of |dL/d(projected centre)|, per px; not by `torch`.

    Raises:
        InputError: the camera has lens distortion, the pose no rotation, the tensors don't fit together, or the backend
            not their device.
        MissingDependency: the backend's package is not installed.
    """
    _require_splats(centers, rotations, scales, opacities, colours)
    if frame_rotations is not None:
        _require_shape("frame_rotations", frame_rotations, [(len(centers), 3, 3)], "give one for each splat")
    if screen_gradients is not None:
        _require_shape("screen_gradients", screen_gradients, [(len(centers), 2)], "give room for each splat")
    if not isinstance(world_from_camera, Tensor):
        world_from_camera = torch.tensor(world_from_camera)  # a copy: surveys' arrays are read-only
    world_from_camera = world_from_camera.double()
    behind = torch.as_tensor(background, dtype=centers.dtype, device=centers.device)
    _require_view(camera, world_from_camera, behind)
    pose = camera_from(world_from_camera).to(centers.device)
    shown = [_depths(centers, pose)] if depth else []
    shown += [_normals(centers, rotations, scales, pose)] if normals else []
    features = torch.stack(shown) if shown else centers.new_empty(0, len(centers), 3)
    draw = draw_with(backend or choose_backend(centers.device), centers.device)
    drawing = draw(
        centers, rotations, scales, opacities, colours, features, behind, pose, camera, antialiased, frame_rotations,
        screen_gradients,
    )  # fmt: skip
    return Raster.of(drawing, features[0, :, 0] if depth else None, normals)


def _require_splats(centers: Tensor, rotations: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor) -> None:
    count = len(centers)
    one_order = "give all splats in one order"
    _require_shape("centers", centers, [(count, 3)], one_order)
    _require_shape("rotations", rotations, [(count, 4)], one_order)
    _require_shape("scales", scales, [(count, 3)], one_order)
    _require_shape("opacities", opacities, [(count,)], one_order)
    _require_shape(
        "colours",
        colours,
        [(count, 3), *((count, terms, 3) for terms in (1, 4, 9, 16))],
        "give (splat, 3), or harmonics of degree 0 to 3: (splat, 1, 4, 9 or 16, 3)",
    )


def _require_view(camera: Camera, world_from_camera: Tensor, background: Tensor) -> None:
    if any(camera.distortion):
        raise InputError(
            "a camera with lens distortion can't be rasterised",
            where=f"distortion {camera.distortion}",
            cure="undistort the photograph and its camera with slideframe.photographs.load_photograph",
        )
    _require_shape("background", background, [(3,)], "give red, green and blue")
    _require_shape("world_from_camera", world_from_camera, [(3, 4)], "give the first three rows of the pose")
    turn = world_from_camera[:, :3].detach()
    if not torch.allclose(turn @ turn.T, torch.eye(3, dtype=turn.dtype, device=turn.device), atol=POSE_TOLERANCE):
        raise InputError(
            "'world_from_camera' doesn't begin with a rotation",
            where=str(turn.tolist()),
            cure="give a rotation matrix without a scale, and make it one again after each step of a refinement",
        )


def _require_shape(name: str, array: Tensor | Float32Array, allowed: list[tuple[int, ...]], cure: str) -> None:
    if tuple(array.shape) not in allowed:
        raise InputError(f"'{name}' has shape {tuple(array.shape)}, not {' or '.join(map(str, allowed))}", cure=cure)


def _depths(centers: Tensor, pose: Tensor) -> Tensor:
    """Return what each splat shows in the first group of channels (splat, 3): its depth, and nothing."""
    along = centers.to(pose.dtype) @ pose[2, :3] + pose[2, 3]
    return torch.nn.functional.pad(along[:, None], (0, 2)).to(centers.dtype)


def _normals(centers: Tensor, rotations: Tensor, scales: Tensor, pose: Tensor) -> Tensor:
    """Return each splat's shortest axis, turned to the camera."""
    rows = torch.arange(len(centers))
    axes = rotation_matrices(rotations)[rows, :, scales.detach().argmin(dim=1)] if len(centers) else centers
    towards = (-pose[:, :3].T @ pose[:, 3]).to(centers.dtype).detach() - centers.detach()
    facing = (axes.detach() * towards).sum(dim=1, keepdim=True) >= 0
    return torch.where(facing, axes, -axes)


def _median_depth(depths: Tensor, median: Tensor) -> Tensor:
    """Return the depth of the splats whose indices (height, width) are given; 0 where the index is -1."""
    if not len(depths):
        return depths.new_zeros(median.shape)
    return torch.where(median >= 0, depths[median.clamp_min(0)], depths.new_zeros(()))
