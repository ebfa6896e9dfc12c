"""How splats ride on particles: positions, shapes and colours of all splats at an output time."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array
from slideframe.errors import InputError
from slideframe.products import Filling, ParticleFrame, SplatCloud
from slideframe.singular_values import decompose

# A splat stretched further is a needle, squeezed further a hole in the ground.
LEAST_STRETCH, MOST_STRETCH = 0.5, 2.0


@dataclass(frozen=True)
class MovedSplats:
    """All splats at one time: the observed ones in their order, then the interior.

    Attributes:
        centers: (splat, 3), m.
        rotations: (splat, 4), quaternions wxyz.
        scales: (splat, 3), standard deviations, m.
        opacities: (splat,); those of interior splats grow from 0 as their particles leave their places.
        harmonics: (splat, coefficient, 3), as at t = 0; see `frame_rotations`.
        frame_rotations: (splat, 3, 3), rotation R of the ground about each splat since t = 0. A splat seen
            along d has the colour of its harmonics at R^T d, which is exact for every band.
    """

    centers: Float32Array
    rotations: Float32Array
    scales: Float32Array
    opacities: Float32Array
    harmonics: Float32Array
    frame_rotations: Float32Array

    def __len__(self) -> int:
        return len(self.centers)


class Coupling:
    """The splats of a scene and the particles that carry them.

    A splat on particle p moves with the ground about it, x = x_p + F (X - X_p) and S' = F S F^T, where F
    is the particle's deformation gradient with its singular values held between LEAST_STRETCH and
    MOST_STRETCH. Splats without a particle, and those whose particle is as at t = 0, keep their bits.

    An interior splat stays hidden while its particle is where it began, because what the photographs
    showed is still there to be seen, and is bare once the particle has gone its own width.
    """

    def __init__(self, splats: SplatCloud, filling: Filling) -> None:
        """Precompute what no frame changes.

        Raises:
            InputError: the filling was made for other splats.
        """
        if len(filling.surface_particles) != len(splats):
            raise InputError(
                f"the filling couples {len(filling.surface_particles)} splats but there are {len(splats)}",
                cure="fill the volume anew from these splats",
            )
        self._rest = _at_rest(splats, filling.interior)
        carriers = np.concatenate([filling.surface_particles, filling.interior_particles])
        self._moving = np.flatnonzero(carriers >= 0)
        self._particles, self._carrier = np.unique(carriers[self._moving], return_inverse=True)
        self._start = filling.particle_positions[self._particles].astype(np.float64)
        self._offsets = self._rest.centers[self._moving].astype(np.float64) - self._start[self._carrier]
        axes = rotation_matrices(self._rest.rotations[self._moving].astype(np.float64))
        self._axes = axes * self._rest.scales[self._moving][:, None, :]
        self._particle_count = len(filling.particle_positions)
        self._interior = slice(len(splats), None)
        self._interior_carriers = np.searchsorted(self._particles, filling.interior_particles)
        self._widths = np.cbrt(filling.particle_volumes[self._particles].astype(np.float64))

    def __len__(self) -> int:
        return len(self._rest)

    def at(self, frame: ParticleFrame) -> MovedSplats:
        """Return every splat at the frame's time.

        Raises:
            InputError: the frame is of other particles than the filling's.
        """
        if len(frame.positions) != self._particle_count:
            raise InputError(
                f"the frame at {frame.time:g} s has {len(frame.positions)} particles, not {self._particle_count}",
                cure="simulate this filling anew",
            )
        positions = frame.positions[self._particles].astype(np.float64)
        gradients = frame.deformation_gradients[self._particles].astype(np.float64)
        changed = (positions != self._start).any(axis=1) | (gradients != np.eye(3)).any(axis=(1, 2))
        gradients[changed], turned = clamp_stretch(gradients[changed])
        rotations = np.tile(np.eye(3), (len(gradients), 1, 1))
        rotations[changed] = turned
        rows = np.flatnonzero(changed[self._carrier])
        opacities = self._rest.opacities.copy()
        travelled = np.linalg.norm(positions - self._start, axis=1)
        opacities[self._interior] *= np.minimum(travelled / self._widths, 1.0)[self._interior_carriers]
        return self._place(rows, positions, gradients, rotations, opacities)

    def _place(
        self,
        rows: npt.NDArray[np.int64],
        positions: Float64Array,
        gradients: Float64Array,
        rotations: Float64Array,
        opacities: Float32Array,
    ) -> MovedSplats:
        """Copy the splats at rest and overwrite the moved ones; `rows` index the moving splats."""
        rest, splat, carrier = self._rest, self._moving[rows], self._carrier[rows]
        centers, quaternions, scales = rest.centers.copy(), rest.rotations.copy(), rest.scales.copy()
        turned = rest.frame_rotations.copy()
        F = gradients[carrier]
        centers[splat] = positions[carrier] + (F @ self._offsets[rows, :, None])[:, :, 0]
        axes, sizes, _ = decompose(F @ self._axes[rows])
        quaternions[splat], scales[splat] = quaternions_of(axes), sizes
        turned[splat] = rotations[carrier]
        return MovedSplats(centers, quaternions, scales, opacities, rest.harmonics, turned)


def clamp_stretch(gradients: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return F (n, 3, 3) with its singular values held in bounds, and its rotation R of F = R U (n, 3, 3)."""
    left, values, right = decompose(gradients)
    held = values.clip(LEAST_STRETCH, MOST_STRETCH)
    clamped = (left * held[:, None, :]) @ right.transpose(0, 2, 1)
    return clamped, left @ right.transpose(0, 2, 1)


def rotation_matrices(quaternions: Float64Array) -> Float64Array:
    """Return (n, 3, 3) from quaternions wxyz (n, 4) of any length but zero."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quaternions_of(matrices: Float64Array) -> Float64Array:
    """Return unit quaternions wxyz (n, 4) of rotations (n, 3, 3), from the largest of the four components."""
    m = matrices
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    sum_x, sum_y, sum_z = m[:, 2, 1] + m[:, 1, 2], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 0] + m[:, 0, 1]
    turn_x, turn_y, turn_z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    # row k is 4 q_k q
    candidates = np.array(
        [
            [1 + xx + yy + zz, turn_x, turn_y, turn_z],
            [turn_x, 1 + xx - yy - zz, sum_z, sum_y],
            [turn_y, sum_z, 1 - xx + yy - zz, sum_x],
            [turn_z, sum_y, sum_x, 1 - xx - yy + zz],
        ]
    )
    best = np.argmax(candidates[range(4), range(4)], axis=0)
    chosen = candidates[best, :, np.arange(len(m))]
    unit: Float64Array = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return unit


def _at_rest(splats: SplatCloud, interior: SplatCloud) -> MovedSplats:
    """Join the observed splats and the interior; missing coefficients are zero."""
    coefficients = max(splats.harmonics.shape[1], interior.harmonics.shape[1])
    harmonics = [
        np.pad(cloud.harmonics, ((0, 0), (0, coefficients - cloud.harmonics.shape[1]), (0, 0)))
        for cloud in (splats, interior)
    ]
    return MovedSplats(
        np.concatenate([splats.centers, interior.centers]),
        np.concatenate([splats.rotations, interior.rotations]),
        np.concatenate([splats.scales, interior.scales]),
        np.concatenate([splats.opacities, interior.opacities]),
        np.concatenate(harmonics),
        np.tile(np.eye(3, dtype=np.float32), (len(splats) + len(interior), 1, 1)),
    )
