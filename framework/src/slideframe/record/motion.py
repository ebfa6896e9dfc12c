"""What moves: splats, particles, the map of thickness, and figures, over `sim_time`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from slideframe.arrays import Float32Array, Float64Array
from slideframe.coupling import Coupling, MovedSplats
from slideframe.motion import main_direction, measure
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame, SplatCloud
from slideframe.record.drawing import DRAWN_SPLATS, IndexArray, heat, real_part_last, rgba, spacing_of, thinned
from slideframe.record.maps import ThicknessMap
from slideframe.record.soil import SoilColours, fields_of

# Shapes are logged this many times more rarely than places: they change slowly, and are twice as long.
FRAMES_PER_SHAPE = 4
# bytes of a splat's centre and colour; of its scales and quaternion; of a particle
PLACE_BYTES, SHAPE_BYTES, PARTICLE_BYTES = 16, 28, 16


@dataclass(frozen=True)
class Drawn:
    """What of the motion is drawn: which splats, particles and frames."""

    splats: IndexArray
    particles: IndexArray
    frames: IndexArray

    @classmethod
    def within(cls, splats: int, particles: int, frames: int, budget: int, clouds: int = 1) -> "Drawn":
        """Thin splats and particles to what the viewer can draw, then frames to the budget, bytes.

        `clouds`: how often the particles are drawn.
        """
        drawn, dots = thinned(splats, DRAWN_SPLATS), thinned(particles, DRAWN_SPLATS // 3)
        cost = len(drawn) * (PLACE_BYTES + SHAPE_BYTES // FRAMES_PER_SHAPE) + clouds * len(dots) * PARTICLE_BYTES
        return cls(drawn, dots, thinned(frames, max(2, budget // max(cost, 1))))

    def left_out(self, splats: int, particles: int, frames: int) -> list[str]:
        """Say what isn't drawn of so many, one phrase each."""
        counts = (
            (len(self.splats), splats, "splats"),
            (len(self.particles), particles, "particles"),
            (len(self.frames), frames, "frames of the motion"),
        )
        return [f"{shown} of {total} {what} are drawn" for shown, total, what in counts if shown < total]


def log_motion(
    stream: rr.RecordingStream,
    splats: SplatCloud,
    filling: Filling,
    motion: Sequence[ParticleFrame],
    problem: SimulationProblem,
    budget: int,
    progress: Callable[[int, int], None],
) -> list[str]:
    """Log moving splats, particles coloured by their way and by what frames carry of stress, thickness and figures.

    Moving and static splats are one entity, because the viewer sorts splats by entity.

    Returns:
        What was thinned to stay within the budget, bytes, one phrase each.
    """
    coupling, start = Coupling(splats, filling), filling.particle_positions
    whole = len(coupling), len(start), len(motion)
    drawn = Drawn.within(*whole, budget, clouds=1 + len(fields_of(motion[-1])))
    soil, thickness = SoilColours.over(motion, drawn.frames), ThicknessMap.over(filling, motion[-1])
    direction = main_direction(motion[-1], filling)
    reach = max(float(_distance(motion[-1].positions, start).max()), 1e-6)
    radius = 0.5 * spacing_of(filling)
    places = {int(frame): order for order, frame in enumerate(drawn.frames)}
    stream.log("motion/splats", rr.GaussianSplats3D.from_fields(spherical_harmonics_degree=0), static=True)
    for index, frame in enumerate(motion):
        stream.set_time("sim_time", duration=frame.time)
        stream.set_time("frame", sequence=index)
        _log_figures(stream, frame, filling, problem, direction)
        if index in places:
            _log_splats(stream, coupling, frame, drawn.splats, places[index] % FRAMES_PER_SHAPE == 0)
            positions = frame.positions[drawn.particles]
            colors = heat(_distance(positions, start[drawn.particles]) / reach)
            stream.log("motion/particles", rr.Points3D(positions, colors=colors, radii=radius))
            soil.log(stream, frame, drawn.particles, radius)
            thickness.log(stream, frame)
        progress(index + 1, len(motion))
    return drawn.left_out(*whole)


def _log_splats(
    stream: rr.RecordingStream, coupling: Coupling, frame: ParticleFrame, drawn: IndexArray, shapes: bool
) -> None:
    """Log where the splats are and how bare, and now and then their shapes."""
    moved: MovedSplats | None = coupling.at(frame) if shapes else None
    centers, opacities = (moved.centers, moved.opacities) if moved else coupling.places_at(frame)
    stream.log(
        "motion/splats",
        rr.GaussianSplats3D.from_fields(
            centers=centers[drawn],
            colors=rgba(coupling.rest.harmonics[drawn], opacities[drawn]),
            scales=moved.scales[drawn] if moved else None,
            quaternions=real_part_last(moved.rotations[drawn]) if moved else None,
        ),
    )


def _log_figures(
    stream: rr.RecordingStream,
    frame: ParticleFrame,
    filling: Filling,
    problem: SimulationProblem,
    direction: Float64Array,
) -> None:
    figures = measure(frame, filling, problem, direction)
    stream.log("figures/energy/kinetic", rr.Scalars(figures.kinetic_energy_j))
    stream.log("figures/energy/potential", rr.Scalars(figures.potential_energy_j))
    stream.log("figures/mass/moving", rr.Scalars(figures.moving_mass_kg))
    stream.log("figures/travel/front", rr.Scalars(figures.front_m))
    stream.log("figures/travel/run_out", rr.Scalars(figures.run_out_m))
    stream.log("figures/travel/mean", rr.Scalars(figures.mean_displacement_m))
    stream.log("figures/volume/outside", rr.Scalars(figures.volume_outside_m3))
    stream.log("figures/escaped_particles", rr.Scalars(figures.escaped_particles))


def _distance(here: Float32Array, there: Float32Array) -> Float32Array:
    return np.asarray(np.linalg.norm(here - there, axis=1), np.float32)
