"""How splats ride on particles: positions, shapes and colours of all splats at an output time."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Float64Array
from slideframe.errors import InputError
from slideframe.products import Filling, ParticleFrame, SplatCloud
from slideframe.rotations import quaternions_of, rotation_matrices
from slideframe.singular_values import decompose, within
from slideframe.veils import NO_PARTICLE, particles_over

# A splat stretched further is a needle, squeezed further a hole in the ground.
LEAST_STRETCH, MOST_STRETCH = 0.5, 2.0


@dataclass(frozen=True)
class MovedSplats:
    """All splats at one time: the observed ones in their order, then the interior, then the scar.

    Attributes:
        centers: (splat, 3), m.
        rotations: (splat, 4), quaternions wxyz.
        scales: (splat, 3), standard deviations, m.
        opacities: (splat,); those of interior and scar grow from 0 as the particles that hide them leave.
        harmonics: (splat, coefficient, 3), as at t = 0; see `frame_rotations`.
        frame_rotations: (splat, 3, 3), rotation R of the ground about each splat since t = 0. A splat seen
            along d has the colour of its harmonics at R^T d, which is exact for every band. The identity may
            stand for R where a splat has the same colour from everywhere.
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
    showed is still there to be seen, and is bare once the particle has gone its own width; a splat of the
    scar likewise, with the particle that lay nearest to it. It is bare from the start where none did.

    Attributes:
        rest: all splats at t = 0, none hidden.
        moving: (row,), the splats that follow a particle.
        particles: (carrier,), the particles that carry or hide splats, by their place in a frame.
        carriers: (row,), the carrier of each moving splat, an index into `particles`.
        start: (carrier, 3), positions at t = 0, m.
        widths: (carrier,), edges of the cubes of soil that they stand for, m.
        offsets: (row, 3), from carrier to splat at t = 0, m.
        axes: (row, 3, 3), A = R S of each moving splat at t = 0, whose A A^T is the covariance, m.
        veiled: (hidden,), the splats that are hidden at t = 0.
        veils: (hidden,), the carrier whose leaving bares them.
        varied: (row,), whether a moving splat's colour depends on the direction it is seen from.
        turns: (carrier,), whether it carries such a splat, so that its rotation matters.
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
        self.rest = _at_rest(splats, filling.interior, filling.scar)
        positions, volumes = filling.particle_positions, filling.particle_volumes
        over = particles_over(filling.scar.centers, positions, float(np.cbrt(volumes.max(initial=0))))
        static = np.full(len(filling.scar), NO_PARTICLE)
        follows = np.concatenate([filling.surface_particles, filling.interior_particles, static])
        hidden_by = np.concatenate([np.full(len(splats), NO_PARTICLE), filling.interior_particles, over])
        self.moving = np.flatnonzero(follows != NO_PARTICLE)
        self.veiled = np.flatnonzero(hidden_by != NO_PARTICLE)
        used = np.concatenate([follows[self.moving], hidden_by[self.veiled]])
        self.particles, places = np.unique(used, return_inverse=True)
        self.carriers, self.veils = np.split(places, [len(self.moving)])
        self.start = positions[self.particles].astype(np.float64)
        self.widths = np.cbrt(volumes[self.particles].astype(np.float64))
        self.offsets = self.rest.centers[self.moving].astype(np.float64) - self.start[self.carriers]
        turned = rotation_matrices(self.rest.rotations[self.moving].astype(np.float64))
        self.axes = turned * self.rest.scales[self.moving][:, None, :]
        self.varied = self.rest.harmonics[self.moving, 1:].any(axis=(1, 2))
        self.turns = np.zeros(len(self.particles), np.bool_)
        self.turns[self.carriers[self.varied]] = True
        self._particle_count = len(positions)

    def __len__(self) -> int:
        return len(self.rest)

    def require_particles_of(self, frame: ParticleFrame) -> None:
        """Raise InputError where the frame is of other particles than the filling's."""
        if len(frame.positions) != self._particle_count:
            raise InputError(
                f"the frame at {frame.time:g} s has {len(frame.positions)} particles, not {self._particle_count}",
                cure="simulate this filling anew",
            )

    def at(self, frame: ParticleFrame) -> MovedSplats:
        """Return every splat at the frame's time, in float64 until the end.

        Raises:
            InputError: the frame is of other particles than the filling's.
        """
        rest, carried = self.rest, self._carry(frame)
        splat, carrier = self.moving[carried.rows], self.carriers[carried.rows]
        quaternions, scales, turned = rest.rotations.copy(), rest.scales.copy(), rest.frame_rotations.copy()
        axes, sizes, _ = decompose(carried.gradients[carrier] @ self.axes[carried.rows])
        quaternions[splat], scales[splat] = quaternions_of(axes), sizes
        turned[splat] = carried.rotations[carrier]
        return MovedSplats(carried.centers, quaternions, scales, carried.opacities, rest.harmonics, turned)

    def places_at(self, frame: ParticleFrame) -> tuple[Float32Array, Float32Array]:
        """Return only centres (splat, 3), m, and opacities (splat,), several times faster."""
        carried = self._carry(frame)
        return carried.centers, carried.opacities

    def _carry(self, frame: ParticleFrame) -> "_Carried":
        """Hold the stretch of the particles that changed, and move the centres on them."""
        self.require_particles_of(frame)
        positions = frame.positions[self.particles].astype(np.float64)
        gradients = frame.deformation_gradients[self.particles].astype(np.float64)
        changed = (positions != self.start).any(axis=1) | (gradients != np.eye(3)).any(axis=(1, 2))
        wild = changed & ~within(gradients, LEAST_STRETCH, MOST_STRETCH)
        rotations = np.tile(np.eye(3), (len(gradients), 1, 1))
        treated = wild | (changed & self.turns)
        gradients[treated], rotations[treated] = clamp_stretch(gradients[treated])
        rows = np.flatnonzero(changed[self.carriers])
        splat, carrier = self.moving[rows], self.carriers[rows]
        centers, opacities = self.rest.centers.copy(), self.rest.opacities.copy()
        centers[splat] = positions[carrier] + (gradients[carrier] @ self.offsets[rows, :, None])[:, :, 0]
        travelled = np.linalg.norm(positions - self.start, axis=1)
        opacities[self.veiled] *= np.minimum(travelled / self.widths, 1.0)[self.veils]
        return _Carried(rows, gradients, rotations, centers, opacities)


class _Carried(NamedTuple):
    """What a frame makes of the carriers: the rows that moved, F and its rotation by carrier, and where splats are."""

    rows: npt.NDArray[np.int64]
    gradients: Float64Array
    rotations: Float64Array
    centers: Float32Array
    opacities: Float32Array


def clamp_stretch(gradients: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return F (n, 3, 3) with its singular values held in bounds, and its rotation R of F = R U (n, 3, 3)."""
    left, values, right = decompose(gradients)
    held = values.clip(LEAST_STRETCH, MOST_STRETCH)
    clamped = (left * held[:, None, :]) @ right.transpose(0, 2, 1)
    return clamped, left @ right.transpose(0, 2, 1)


def _at_rest(*clouds: SplatCloud) -> MovedSplats:
    """Join the clouds; missing coefficients are zero."""
    coefficients = max(cloud.harmonics.shape[1] for cloud in clouds)
    harmonics = [
        np.pad(cloud.harmonics, ((0, 0), (0, coefficients - cloud.harmonics.shape[1]), (0, 0))) for cloud in clouds
    ]
    joined = {
        name: np.concatenate([getattr(cloud, name) for cloud in clouds])
        for name in ("centers", "rotations", "scales", "opacities")
    }
    still = np.tile(np.eye(3, dtype=np.float32), (sum(map(len, clouds)), 1, 1))
    return MovedSplats(**joined, harmonics=np.concatenate(harmonics), frame_rotations=still)
