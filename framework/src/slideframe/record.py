"""The rerun recording: one function per product type, one blueprint. The only importer of rerun.

Everything is in the local east-north-up frame. Moving and static splats are one entity, because the viewer
sorts splats per entity. What is drawn is thinned to a budget; the store keeps everything.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image

from slideframe.arrays import Float32Array, UInt8Array
from slideframe.coupling import Coupling, MovedSplats
from slideframe.errors import StoreError
from slideframe.motion import measure
from slideframe.photographs import load_photograph
from slideframe.problem import SimulationProblem
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey

IndexArray = npt.NDArray[np.int64]

APPLICATION = "slideframe"
# far more than a recording of the budget below takes on a slow disk
FLUSH_SECONDS = 120.0
# bytes that moving centres may take; the rest of a demo recording is below 60 MB
MOTION_BUDGET_BYTES = 150_000_000
DRAWN_SPLATS = 300_000
PHOTOGRAPH_WIDTH = 480
DRAWN_PHOTOGRAPHS = 120
SURVEY_MAPS = ("cameras", "overlap", "angles", "distances", "residuals")
# zeroth real spherical harmonic, 1 / (2 sqrt(pi))
HARMONIC_0 = 0.28209479177387814
OBSERVED_COLOR = (90, 170, 120)
INFERRED_COLOR = (200, 120, 60)
SUPPORT_COLORS = np.array([OBSERVED_COLOR, (230, 190, 60), INFERRED_COLOR], np.uint8)


class Eye(NamedTuple):
    """A place in the local frame, m, and what is looked at from there."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]


class Recording:
    """One .rrd file being written; it appears under its name when closed."""

    def __init__(self, path: Path, name: str, eye: Eye | None = None, *, active_tab: int = 0) -> None:
        """Open the file beside its final place, blueprint first; `eye` is where the 3-D views look from."""
        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        self.stream = rr.RecordingStream(APPLICATION, recording_id=name)
        self.stream.save(self._partial, default_blueprint=blueprint(eye, active_tab))
        self.stream.send_recording_name(name)
        self.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def close(self) -> None:
        """Finish the file and give it its name."""
        try:
            self.stream.flush(timeout_sec=FLUSH_SECONDS)
        except Exception as error:  # rerun's own classes; a full disk stops its writer without a word
            raise StoreError(
                f"the recording can't be written: {error}",
                where=str(self._partial),
                cure="free some space; the same command goes on from here",
            ) from error
        self.stream.disconnect()
        self._partial.rename(self._path)


def blueprint(eye: Eye | None, active_tab: int = 0) -> rrb.Blueprint:
    """Lay out the scan, the volume, the motion, the film, the plots and the report."""
    controls = rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0, 0, 1)) if eye else None
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="/", contents=["/motion/splats"], name="Motion", eye_controls=controls),
                rrb.Vertical(
                    rrb.Spatial2DView(origin="/film", name="Film"),
                    rrb.TimeSeriesView(origin="/figures/energy", name="Energy, J"),
                    rrb.TimeSeriesView(origin="/figures/travel", name="Travel, m"),
                ),
                column_shares=[3, 2],
                name="Motion",
            ),
            rrb.Spatial3DView(
                origin="/",
                contents=["/survey/points", "/survey/cameras/**", "/reconstruction/**"],
                name="Scan",
                eye_controls=controls,
            ),
            rrb.Grid(
                *(rrb.Spatial2DView(origin=f"/survey/maps/{name}", name=name.capitalize()) for name in SURVEY_MAPS),
                name="Survey",
            ),
            rrb.Spatial3DView(origin="/", contents=["/volume/**"], name="Volume", eye_controls=controls),
            rrb.Spatial3DView(origin="/", contents=["/motion/particles"], name="Particles", eye_controls=controls),
            rrb.Horizontal(
                rrb.TextDocumentView(origin="/report/result", name="Result"),
                rrb.TextDocumentView(origin="/report/config", name="Configuration"),
                name="Report",
            ),
            active_tab=active_tab,
        ),
        rrb.TimePanel(timeline="sim_time", play_state="paused", state="collapsed"),
        collapse_panels=True,
    )


def log_survey(stream: rr.RecordingStream, survey: Survey) -> None:
    """Log cameras with their photographs, and the sparse points."""
    stream.log("survey/points", rr.Points3D(survey.sparse_points, colors=survey.sparse_colors, radii=-1.5), static=True)
    for index in _thinned(len(survey.photographs), DRAWN_PHOTOGRAPHS):
        pixels, camera, _ = load_photograph(survey, index, width=PHOTOGRAPH_WIDTH)
        entity = f"survey/cameras/{index:04d}_{survey.photographs[index].path.stem}"
        pose = survey.world_from_camera[index]
        stream.log(
            entity,
            rr.Transform3D(translation=pose[:, 3], mat3x3=pose[:, :3]),
            rr.Pinhole(
                resolution=[camera.width, camera.height],
                focal_length=[camera.focal_x, camera.focal_y],
                principal_point=[camera.principal_x, camera.principal_y],
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=4.0,
            ),
            rr.EncodedImage(contents=_jpeg(pixels), media_type="image/jpeg"),
            static=True,
        )


def log_survey_maps(stream: rr.RecordingStream, maps: Mapping[str, Image.Image]) -> None:
    """Log the maps of the survey's quality, by name."""
    for name, picture in maps.items():
        buffer = io.BytesIO()
        picture.save(buffer, "PNG")
        stream.log(
            f"survey/maps/{name}", rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"), static=True
        )


def log_splats(stream: rr.RecordingStream, splats: SplatCloud) -> None:
    """Log the reconstruction as scanned."""
    drawn = _thinned(len(splats), DRAWN_SPLATS)
    stream.log(
        "reconstruction/splats",
        rr.GaussianSplats3D(
            splats.centers[drawn],
            colors=_rgba(splats.harmonics[drawn], splats.opacities[drawn]),
            spherical_harmonics_degree=0,
            scales=splats.scales[drawn],
            quaternions=_real_part_last(splats.rotations[drawn]),
        ),
        static=True,
    )


def log_filling(stream: rr.RecordingStream, filling: Filling) -> None:
    """Log the surface, coloured by its support, and the inferred particles beside the observed ones."""
    stream.log(
        "volume/surface",
        rr.Mesh3D(
            vertex_positions=filling.surface_vertices,
            triangle_indices=filling.surface_triangles,
            vertex_colors=SUPPORT_COLORS[filling.surface_support],
        ),
        static=True,
    )
    drawn = _thinned(len(filling.particle_positions), DRAWN_SPLATS)
    stream.log(
        "volume/inferred",
        rr.Points3D(filling.particle_positions[drawn], colors=INFERRED_COLOR, radii=0.3 * _spacing(filling)),
        static=True,
    )


def log_motion(
    stream: rr.RecordingStream,
    splats: SplatCloud,
    filling: Filling,
    motion: Sequence[ParticleFrame],
    problem: SimulationProblem,
    progress: Callable[[int, int], None],
) -> list[str]:
    """Log moving splats, particles coloured by the way they went, and figures, over `sim_time`.

    Returns:
        What was thinned, one phrase each.
    """
    coupling = Coupling(splats, filling)
    splat_count = len(splats) + len(filling.interior)
    drawn = _thinned(splat_count, DRAWN_SPLATS)
    particles = _thinned(len(filling.particle_positions), DRAWN_SPLATS // 3)
    frames = set(_thinned(len(motion), max(2, MOTION_BUDGET_BYTES // (16 * (len(drawn) + len(particles))))))
    _log_lasting_fields(stream, coupling.at(motion[0]), drawn)
    initial = filling.particle_positions[particles]
    reach = max(float(_distance(motion[-1].positions[particles], initial).max()), 1e-6)
    radius = 0.5 * _spacing(filling)
    for index, frame in enumerate(motion):
        stream.set_time("sim_time", duration=frame.time)
        _log_figures(stream, frame, filling, problem)
        if index in frames:
            moved = coupling.at(frame)
            colors = _rgba(moved.harmonics[drawn], moved.opacities[drawn])
            stream.log("motion/splats", rr.GaussianSplats3D.from_fields(centers=moved.centers[drawn], colors=colors))
            positions = frame.positions[particles]
            heat = _heat(_distance(positions, initial) / reach)
            stream.log("motion/particles", rr.Points3D(positions, colors=heat, radii=radius))
        progress(index + 1, len(motion))
    thinned = ((len(drawn), splat_count, "splats"), (len(frames), len(motion), "frames of moving splats"))
    return [f"{shown} of {total} {what} are drawn" for shown, total, what in thinned if shown < total]


def log_film(stream: rr.RecordingStream, film: Sequence[Picture]) -> None:
    """Log the pictures over `sim_time`."""
    for picture in film:
        stream.set_time("sim_time", duration=picture.time)
        stream.log("film", rr.EncodedImage(contents=_jpeg(picture.pixels), media_type="image/jpeg"))


def log_report(stream: rr.RecordingStream, result: str, config: str) -> None:
    """Log the result table (markdown) and the resolved config (TOML)."""
    stream.log("report/result", rr.TextDocument(result, media_type="text/markdown"), static=True)
    stream.log("report/config", rr.TextDocument(f"```toml\n{config}\n```", media_type="text/markdown"), static=True)


def _log_figures(
    stream: rr.RecordingStream, frame: ParticleFrame, filling: Filling, problem: SimulationProblem
) -> None:
    figures = measure(frame, filling, problem)
    stream.log("figures/energy/kinetic", rr.Scalars(figures.kinetic_energy_j))
    stream.log("figures/energy/potential", rr.Scalars(figures.potential_energy_j))
    stream.log("figures/travel/run_out", rr.Scalars(figures.run_out_m))
    stream.log("figures/travel/mean", rr.Scalars(figures.mean_displacement_m))
    stream.log("figures/escaped_particles", rr.Scalars(figures.escaped_particles))


def _log_lasting_fields(stream: rr.RecordingStream, moved: MovedSplats, drawn: IndexArray) -> None:
    """Log what does not change; a component that is logged static may never be logged over time."""
    stream.log(
        "motion/splats",
        rr.GaussianSplats3D.from_fields(
            scales=moved.scales[drawn],
            quaternions=_real_part_last(moved.rotations[drawn]),
            spherical_harmonics_degree=0,
        ),
        static=True,
    )


def _real_part_last(rotations: Float32Array) -> Float32Array:
    return np.roll(rotations, -1, axis=1)


def _rgba(harmonics: Float32Array, opacities: Float32Array) -> UInt8Array:
    color = 0.5 + HARMONIC_0 * harmonics[:, 0]
    return np.round(np.clip(np.column_stack([color, opacities]), 0, 1) * 255).astype(np.uint8)


def _heat(share: Float32Array) -> UInt8Array:
    """Colour 0 grey-blue, 0.5 yellow, 1 red."""
    stops = np.array([[70, 90, 130], [240, 210, 80], [190, 30, 30]], float)
    channels = [np.interp(share, [0, 0.5, 1], stops[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=1).astype(np.uint8)


def _distance(here: Float32Array, there: Float32Array) -> Float32Array:
    return np.asarray(np.linalg.norm(here - there, axis=1), np.float32)


def _spacing(filling: Filling) -> float:
    return float(np.cbrt(np.median(filling.particle_volumes)))


def _thinned(count: int, most: int) -> IndexArray:
    """Return at most `most` indices below `count`, evenly spread, first and last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _jpeg(pixels: UInt8Array) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=88)
    return buffer.getvalue()
