"""What a run leaves for people: one folder with the figures, the film, the recording and exchange files.

run.toml        the resolved configuration; runs the same again
result.json     each stage's figures under its kind
log.jsonl       everything that was logged
film.mp4        H.264, plays in real time
contact_sheet.png, before_after.png   its pictures in a table; the first beside the last
recording.rrd   every product, for the rerun viewer
survey.html     the survey's quality, with maps
splats.ply      the reconstruction, in the layout that splat viewers read
cameras/        COLMAP model, as text and binary, and transforms.json
particles/      -> the solver's frames in the store, one folder of .npy files each
"""

import fcntl
import json
import logging
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slideframe.bench import Bench
from slideframe.config import RunConfig, write_toml
from slideframe.errors import StoreError
from slideframe.modes import chosen
from slideframe.motion import measure
from slideframe.release.plan import plan_of
from slideframe.showing import COMPARISON, FILM, SHEET, Showing
from slideframe.stages import StageKind
from slideframe.store import storing
from slideframe.survey_folder import (
    CAMERAS,
    REPORT,
    appraise_survey,
    survey_result,
    write_cameras,
    write_report,
    write_result,
)

if TYPE_CHECKING:
    from PIL import Image

    from slideframe.quality.appraisal import Appraisal
    from slideframe.quality.surface import SurfaceComparison

RESULT, CONFIG, LOG, RECORDING = "result.json", "run.toml", "log.jsonl", "recording.rrd"


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run."""

    folder: Path

    def open(self, config: RunConfig) -> None:
        """Make the folder and write the resolved config."""
        with storing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            write_toml(config, self.folder / CONFIG)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder, so that two runs never write into it at once.

        Raises:
            StoreError: another run holds it.
        """
        with storing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = (self.folder / ".lock").open("w")
        with handle:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise StoreError(
                    "another run is writing into this folder",
                    where=str(self.folder),
                    cure="wait for it, or name another --out",
                ) from error
            yield

    def is_current(self, config: RunConfig, bench: Bench, film: bool) -> bool:
        """Whether the folder already holds everything of these very results, made as the config asks."""
        files = [RESULT, RECORDING] + [FILM] * (film and "renderer" in bench.results)
        if not all((self.folder / name).is_file() for name in files):
            return False
        stored = json.loads((self.folder / RESULT).read_text(encoding="utf-8"))
        made_as = stored["outputs"].get("config", {})
        asked = config.model_dump(mode="json", include={"outputs", "reference_ground"})
        return bool(stored["keys"] == _keys(bench) and all(made_as.get(name) == asked[name] for name in asked))

    def deliver(
        self, config: RunConfig, bench: Bench, film: bool, progress: Callable[[str, float, float], None]
    ) -> None:
        """Write everything that the results at hand allow; `result.json` last."""
        with storing(self.folder):
            for name in (
                RESULT,
                RECORDING,
                FILM,
                SHEET,
                COMPARISON,
                REPORT,
                "splats.ply",
                "particles",
            ):  # nothing of another result stays
                (self.folder / name).unlink(missing_ok=True)
            shutil.rmtree(self.folder / CAMERAS, ignore_errors=True)
        left_out = self._exchange_files(bench)
        if film and "renderer" in bench.results:
            self._film(config, bench, progress)
        appraisal, maps = self._survey_report(config, bench)
        result, comparison = self._result(config, bench, appraisal), self._comparison(config, bench)
        if comparison is not None:
            spacing = result["volume_filler"].get("splat_spacing_m")
            result["volume_filler"] |= comparison.figures(spacing if isinstance(spacing, float) else None)
        # so that the folder's products can be found and shown again, whatever is in run.toml by then
        result["outputs"] = {"store": str(bench.store.folder.resolve()), "config": config.model_dump(mode="json")}
        result["outputs"]["mode"] = mode_of(config)
        result["outputs"]["left_out"] = left_out
        result["outputs"]["thinned_in_recording"] = self._recording(config, bench, result, comparison, maps, progress)
        write_result(self.folder / RESULT, result)

    def _survey_report(self, config: RunConfig, bench: Bench) -> "tuple[Appraisal | None, dict[str, Image.Image]]":
        if "pose_source" not in bench.results:
            return None, {}
        from slideframe.quality.drawing import draw_maps

        keyed = bench.results["pose_source"]
        appraisal = appraise_survey(keyed, config.region)
        maps = draw_maps(appraisal)
        write_report(self.folder, self.folder.name, keyed, appraisal, maps)
        return appraisal, maps

    def _comparison(self, config: RunConfig, bench: Bench) -> "SurfaceComparison | None":
        """Compare the surface with ground known from elsewhere, where the config names some."""
        if config.reference_ground is None or "volume_filler" not in bench.results:
            return None
        from slideframe.quality.surface import compare_surface

        georeference = bench.results["pose_source"].value.georeference
        plan = plan_of(config.region, georeference)
        return compare_surface(bench.results["volume_filler"].value, plan, config.reference_ground, georeference)

    def _exchange_files(self, bench: Bench) -> list[str]:
        """Write other programs' formats; return why one was left out, where its format can't hold the survey."""
        from slideframe.formats.splat_ply import write_splat_ply

        left_out = []
        with storing(self.folder):
            if "pose_source" in bench.results:
                left_out = write_cameras(bench.results["pose_source"].value, self.folder)
            if "reconstructor" in bench.results:
                write_splat_ply(bench.results["reconstructor"].value, self.folder / "splats.ply")
            if "solver" in bench.results:
                link = self.folder / "particles"
                link.symlink_to(bench.results["solver"].entry.folder.resolve(), target_is_directory=True)
        return left_out

    def _film(self, config: RunConfig, bench: Bench, progress: Callable[[str, float, float], None]) -> None:
        values = [bench.results[kind].value for kind in ("pose_source", "volume_filler", "renderer")]
        Showing(config, *values).write(self.folder, progress)

    def _recording(
        self,
        config: RunConfig,
        bench: Bench,
        result: Mapping[str, Any],
        comparison: "SurfaceComparison | None",
        maps: "Mapping[str, Image.Image]",
        progress: Callable[[str, float, float], None],
    ) -> list[str]:
        from slideframe.record.run import RunProducts

        values = {kind: keyed.value for kind, keyed in bench.results.items()}
        pictures = bench.results["reconstructor"].entry.pictures if "reconstructor" in values else None
        products = RunProducts(config, values, result.get("volume_filler", {}), comparison, maps, pictures)
        with storing(self.folder):
            return products.record(
                self.folder / RECORDING,
                self.folder.name,
                lambda thinned: result_table(result, thinned),
                lambda done, total: progress("recording", done, total),
            )

    def _result(self, config: RunConfig, bench: Bench, appraisal: "Appraisal | None") -> dict[str, Any]:
        result: dict[str, Any] = {"keys": _keys(bench)}
        for kind, keyed in bench.results.items():
            if kind == "pose_source" and appraisal:
                result[kind] = survey_result(keyed, appraisal, kind in bench.computed)
                continue
            manifest = keyed.entry.manifest
            distribution, plugin, version = manifest["made_from"]["plugin"]
            result[kind] = {
                "plugin": plugin,
                "distribution": f"{distribution} {version}",
                "computed_in_this_run": kind in bench.computed,
                **manifest["figures"],
                "warnings": manifest["warnings"],
            }
        if "solver" in bench.results:
            last = measure(
                bench.results["solver"].value[-1], bench.results["volume_filler"].value, config.simulation_problem
            )
            result["solver"] |= {f"final_{name}": value for name, value in vars(last).items()}
        return result


def mode_of(config: RunConfig) -> dict[str, Any] | None:
    """Return the config's mode and the options that it presets, each with the run's value and the mode's."""
    if config.mode is None:
        return None
    return {"name": config.mode, "presets": {option.key: [option.value, option.preset] for option in chosen(config)}}


def _mode_lines(mode: Mapping[str, Any]) -> list[str]:
    lines = [f"\n## mode: {mode['name']}", "", "| option | value | from |", "|---|---|---|"]
    for key, (value, preset) in mode["presets"].items():
        source = "the mode" if value == preset else f"the config; the mode has {preset}"
        lines.append(f"| {key} | {value} | {source} |")
    return lines


def result_table(result: Mapping[str, Any], thinned: list[str]) -> str:
    """Return the figures of `result.json` as markdown tables: what the mode presets, then one for each stage."""
    lines = ["# Result"]
    if mode := result.get("outputs", {}).get("mode"):
        lines += _mode_lines(mode)
    for kind, figures in result.items():
        if kind in ("keys", "outputs"):
            continue
        lines += [f"\n## {kind}", "", "| figure | value |", "|---|---|"]
        lines += [f"| {name} | {_shown(value)} |" for name, value in figures.items() if name != "warnings"]
        lines += [f"\n> {warning}" for warning in figures["warnings"]]
    lines += [f"\n{sentence}; the store holds all." for sentence in thinned]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_shown(part)}" for name, part in value.items())
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _keys(bench: Bench) -> dict[StageKind, str]:
    return {kind: keyed.key for kind, keyed in bench.results.items()}


class JsonLines(logging.Handler):
    """Writes each log record as one JSON object a line."""

    def __init__(self, path: Path) -> None:
        """Append to the file at `path`."""
        super().__init__()
        with storing(path):
            self._stream = path.open("a", encoding="utf-8")

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, traceback included."""
        entry = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(record.created)),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            entry["traceback"] = logging.Formatter().formatException(record.exc_info)
        with suppress(OSError):  # a full disk is told by what failed to be stored, not by the log of it
            self._stream.write(json.dumps(entry) + "\n")
            self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):
            self._stream.close()
        super().close()
