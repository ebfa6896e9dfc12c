"""All of a run in one recording, within its budget."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slideframe.config import RunConfig
from slideframe.quality.surface import SurfaceComparison
from slideframe.record.blueprint import Eye
from slideframe.record.bodies import log_bodies
from slideframe.record.film import log_film
from slideframe.record.motion import log_motion
from slideframe.record.report import log_report, send_properties
from slideframe.record.scene import log_splats, log_survey, log_survey_maps
from slideframe.record.stream import Recording
from slideframe.record.training import log_training
from slideframe.record.volume import log_filling
from slideframe.release.plan import plan_of
from slideframe.showing import soil_bounds
from slideframe.stages import StageKind

if TYPE_CHECKING:
    from PIL import Image

# of the budget, for figures, maps of thickness, the report and the file's own index
RESERVE = 0.08


@dataclass(frozen=True)
class RunProducts:
    """What there is of a run to be recorded.

    Attributes:
        config: of the run.
        values: the products by their stages' kinds.
        figures: of the volume filler, and of the comparison of its surface with a reference ground.
        comparison: that comparison, where there is such a reference.
        maps: of the survey's quality, by name.
        pictures: the folder of those that the reconstructor showed, if it did.
    """

    config: RunConfig
    values: Mapping[StageKind, Any]
    figures: Mapping[str, Any]
    comparison: SurfaceComparison | None
    maps: "Mapping[str, Image.Image]"
    pictures: Path | None

    def record(
        self, path: Path, name: str, page: Callable[[list[str]], str], progress: Callable[[int, int], None]
    ) -> list[str]:
        """Write the recording; return what was left out, one phrase each.

        What doesn't move is logged first; the motion has what is then left of the budget.

        Args:
            path: of the .rrd file.
            name: of the recording, shown in the viewer.
            page: makes the result page (markdown) from what was left out.
            progress: is told of frames done and of how many.
        """
        recording = Recording(
            path,
            name,
            self._eye(),
            compared=self.comparison is not None,
            stressed=self.config.simulation.record_stress,
            pictured=self.pictures is not None and self.pictures.is_dir(),
        )
        send_properties(recording.stream, self.config)
        self._log_still(recording)
        left_out = self._log_moving(recording, progress)
        log_report(recording.stream, page(left_out), path.with_name("run.toml").read_text(encoding="utf-8"))
        recording.close()
        return left_out

    def _log_still(self, recording: Recording) -> None:
        """Log what doesn't move: the survey, the scan and how it came about, the volume."""
        stream, values, config = recording.stream, self.values, self.config
        if "pose_source" in values:
            log_survey(stream, values["pose_source"])
            recording.flush()
            log_survey_maps(stream, self.maps)
        if "reconstructor" in values:
            log_splats(stream, values["reconstructor"])
        if "volume_filler" in values:
            georeference = values["pose_source"].georeference
            plan = plan_of(config.region, georeference)
            log_filling(stream, values["volume_filler"], plan, self.figures, self.comparison)
            log_bodies(stream, config.boundary, georeference)
        if self.pictures is not None:
            log_training(stream, self.pictures)

    def _log_moving(self, recording: Recording, progress: Callable[[int, int], None]) -> list[str]:
        """Log film and motion within the budget; return what was left out."""
        values, config, left_out = self.values, self.config, []
        if "renderer" in values:
            left_out += log_film(recording.stream, values["renderer"], config.simulation.frame_rate)
        if "solver" in values:
            left = int(config.outputs.recording_megabytes * 1e6 * (1 - RESERVE)) - recording.flush()
            scene = values["reconstructor"], values["volume_filler"], values["solver"]

            def frame_done(done: int, total: int) -> None:
                recording.flush()
                progress(done, total)

            left_out += log_motion(recording.stream, *scene, config.simulation_problem, left, frame_done)
        return left_out

    def _eye(self) -> Eye | None:
        """Look from where the film begins, once it is known where the mass lies."""
        values = self.values
        if "volume_filler" not in values or not len(values["volume_filler"].particle_positions):
            return None
        bounds = soil_bounds(values["volume_filler"])
        _, pose = self.config.view.shot(values["pose_source"], bounds)(0.0)
        target = bounds.mean(axis=0)
        # as far ahead as the mass lies: the camera of a flight needn't look at it
        ahead = pose[:, 3] + pose[:, 2] * max(float((target - pose[:, 3]) @ pose[:, 2]), 1.0)
        return Eye(tuple(pose[:, 3]), tuple(ahead))
