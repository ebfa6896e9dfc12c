"""All splats of a scene at the time of a frame, deforming no more than what moved and shows."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.coupling import MOST_STRETCH, Coupling, MovedSplats, clamp_stretch
from slideframe.products import Camera, ParticleFrame
from slideframe_gs_torch.threads import run_shares
from slideframe_render_gs import deformation_kernels as kernels
from slideframe_render_gs.shape_kernels import reshape


class MovingScene:
    """A coupling followed through frames in any order; it holds the state of one frame."""

    def __init__(self, coupling: Coupling) -> None:
        """Start with every splat at rest."""
        self._coupling, rest = coupling, coupling.rest
        carriers, rows = len(coupling.particles), len(coupling.moving)
        self._positions = np.full((carriers, 3), np.nan, np.float32)
        self._gradients = np.full((carriers, 3, 3), np.nan, np.float32)
        self._held = np.empty((carriers, 3, 3), np.float32)
        self._turned = np.tile(np.eye(3, dtype=np.float32), (carriers, 1, 1))
        self._states, self._at_rest = np.empty(carriers, np.uint8), np.ones(carriers, np.bool_)
        self._axes, self._offsets = coupling.axes.astype(np.float32), coupling.offsets.astype(np.float32)
        self._stale = np.zeros(rows, np.bool_)
        # whatever shape a splat has kept, it is no larger
        self._radii = MOST_STRETCH * rest.scales[coupling.moving].max(axis=1, initial=0)
        self._now = MovedSplats(
            rest.centers.copy(), rest.rotations.copy(), rest.scales.copy(), rest.opacities.copy(),
            rest.harmonics, rest.frame_rotations.copy(),
        )  # fmt: skip

    def at(self, frame: ParticleFrame, camera: Camera, world_from_camera: Float64Array) -> MovedSplats:
        """Return every splat at the frame's time; those that can't touch the camera's picture may have an old shape.

        The arrays are written over by the next frame.

        Raises:
            InputError: the frame is of other particles than the filling's.
        """
        self._coupling.require_particles_of(frame)
        self._follow(frame)
        coupling, rest, now = self._coupling, self._coupling.rest, self._now
        rotation = np.asarray(world_from_camera, np.float64)[:, :3]
        camera_from_world = np.column_stack([rotation.T, -rotation.T @ world_from_camera[:, 3]])
        size = camera.focal_x, camera.focal_y, camera.principal_x, camera.principal_y, camera.width, camera.height
        run_shares(
            reshape, len(coupling.moving), len(coupling.moving),
            coupling.moving, coupling.carriers, self._at_rest, self._held, self._turned, self._axes, coupling.varied,
            self._radii, np.ascontiguousarray(camera_from_world), np.array(size, np.float64),
            rest.rotations, rest.scales, now.centers, now.opacities, self._stale,
            now.rotations, now.scales, now.frame_rotations,
        )  # fmt: skip
        return now

    def _follow(self, frame: ParticleFrame) -> None:
        """Move the centres and lift the veils of what changed since the frame before."""
        coupling, rest, now = self._coupling, self._coupling.rest, self._now
        carriers, rows, veiled = len(coupling.particles), len(coupling.moving), len(coupling.veiled)
        run_shares(
            kernels.follow_particles, carriers, carriers,
            frame.positions, frame.deformation_gradients, coupling.particles, coupling.start, coupling.turns,
            self._positions, self._gradients, self._held, self._turned, self._states, self._at_rest,
        )  # fmt: skip
        if (self._states == kernels.UNCHANGED).all():
            return
        wild = np.flatnonzero(self._states == kernels.OUT_OF_BOUNDS)
        self._held[wild], self._turned[wild] = clamp_stretch(self._held[wild].astype(np.float64))
        run_shares(
            kernels.move_centers, rows, rows,
            coupling.moving, coupling.carriers, self._states, self._at_rest, self._positions, self._held,
            self._offsets, rest.centers, now.centers, self._stale,
        )  # fmt: skip
        run_shares(
            kernels.unveil, veiled, veiled,
            coupling.veiled, coupling.veils, self._states, self._positions, coupling.start, coupling.widths,
            rest.opacities, now.opacities,
        )  # fmt: skip
