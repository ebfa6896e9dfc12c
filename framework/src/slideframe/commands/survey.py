"""`slideframe survey`: the cameras and the report of their quality alone, to know whether to fly again."""

import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import tyro
from pydantic import Field

from slideframe import catalogue, registry
from slideframe.bench import Bench, Keyed
from slideframe.commands.key_flags import has_key_flags, own_arguments, parse_key_flags
from slideframe.commands.progress import Watch
from slideframe.commands.run import logging_to
from slideframe.config import StageChoice, absolute, apply_override, read_toml, validate
from slideframe.crew import device_for
from slideframe.device import parse_device
from slideframe.errors import ConfigurationError, SlideframeError
from slideframe.georeferencing import Heights, require_projected
from slideframe.problem import ProblemModel, Region, Site
from slideframe.products import Survey
from slideframe.run_folder import LOG, RECORDING, RESULT, RunFolder, result_table
from slideframe.stages import PoseSource
from slideframe.store import Store, storing
from slideframe.survey_folder import (
    REPORT,
    appraise_survey,
    survey_result,
    write_cameras,
    write_positions_in,
    write_report,
    write_result,
)

_log = logging.getLogger("slideframe")
SURVEY_TAB, CONFIG = 2, "survey.toml"


@dataclass(frozen=True)
class SurveyOptions:
    """Locate the cameras, report how good the survey is, and tell whether to fly again."""

    photographs: Annotated[Path, tyro.conf.Positional]
    """Folder of photographs, or a config of `slideframe run`, whose region is then what must be covered."""
    pose_source: str | None = None
    """Plugin that finds the cameras."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    out: Path | None = None
    """Folder of the report; by default runs/survey-NAME."""
    store: Path | None = None
    """Folder of stored results, shared with runs; by default `store` beside the report's folder."""
    epsg: int | None = None
    """Projected coordinate system, such as 2326, to write the cameras' positions in as well."""
    vertical_epsg: int | None = None
    """Level of the heights beside it, such as 5738; without, they stay above the WGS84 ellipsoid."""
    geoid_offset: float | None = None
    """How far that level lies above the ellipsoid, m."""
    geoid_grid: Path | None = None
    """The same from a grid that PROJ reads."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Override any key: --set plugins.pose_rtk.refine=false. Also for plugins that are not chosen."""


class SurveyConfig(ProblemModel):
    """What of a run's configuration decides the survey and its appraisal."""

    site: Site
    region: Region | None = None
    stages: StageChoice = StageChoice()
    plugins: dict[str, dict[str, Any]] = Field(default={})
    seed: int = Field(default=0, ge=0)


def main(arguments: Sequence[str]) -> int:
    """Parse, locate, report."""
    own = own_arguments(arguments, SurveyOptions)
    options = tyro.cli(SurveyOptions, args=own or list(arguments), prog="slideframe survey")
    config = read_survey_config(options)
    if has_key_flags(arguments, SurveyOptions):
        config = _parse_tuning(options, config, arguments)
    name = options.photographs.resolve().stem
    out = options.out or Path("runs") / f"survey-{name}"
    heights = _heights(options)
    stage, listing = _pose_source(config)
    device = parse_device(options.device)
    registry.require_backend(stage, listing)
    stage.preflight(config.site, device_for(stage, device))
    store = Store(options.store or out.parent / "store")
    folder = RunFolder(out)
    with folder.locked():
        store.open()
        with logging_to(out / LOG), Watch() as watch:
            bench = Bench(store, {stage.name: listing}, device, config.seed, watch)
            try:
                keyed = bench.step(stage.locate, config.site)
            except SlideframeError as error:
                _log.error("%s", error, exc_info=True)
                raise
            lines = _deliver(out, name, config, keyed, bool(bench.computed))
            if options.epsg is not None:
                lines.append(write_positions_in(keyed.value, out, options.epsg, heights))
    print("\n".join([*lines, "", f"report: {out / REPORT}"]))
    return 0


def _heights(options: SurveyOptions) -> Heights:
    """Return the level of the heights to write; raise now what couldn't be written later.

    Raises:
        ConfigurationError: the options contradict each other, or PROJ doesn't know a code.
    """
    given = {name: getattr(options, name) for name in ("geoid_offset", "geoid_grid")}
    heights = validate(Heights, {"epsg": options.vertical_epsg, **given}, "the options of heights")
    if options.epsg is not None:
        require_projected(options.epsg, heights)
    elif not heights.ellipsoidal:
        raise ConfigurationError(
            "heights of another level are written beside eastings and northings only",
            cure="give --epsg too, or --set plugins.pose_rtk.geoid_offset=N for heights that the photographs state",
        )
    return heights


def read_survey_config(options: SurveyOptions) -> SurveyConfig:
    """Read the folder's or the config's site, region, pose source and plugin tables.

    Raises:
        ConfigurationError: the config is faulty.
    """
    content: dict[str, Any] = {"site": {"photographs": str(options.photographs)}}
    if options.photographs.suffix == ".toml":
        whole = read_toml(options.photographs)
        content = {key: value for key, value in whole.items() if key in SurveyConfig.model_fields}
    for assignment in options.set:
        apply_override(content, assignment)
    if options.pose_source:
        apply_override(content, f'stages.pose_source="{options.pose_source}"')
    return absolute(validate(SurveyConfig, content, str(options.photographs)))


def _parse_tuning(options: SurveyOptions, config: SurveyConfig, arguments: Sequence[str]) -> SurveyConfig:
    """Parse again, with a flag for every key of the site and every option of the pose source."""
    keys = {name: (SurveyConfig.model_fields[name].annotation, getattr(config, name)) for name in ("site", "seed")}
    changed, tuning = parse_key_flags(options, keys, [_pose_source(config)[0]], arguments, "survey DIR")
    whole = {name: getattr(config, name) for name in SurveyConfig.model_fields}
    content = {**whole, **changed, "plugins": config.plugins | tuning}
    return absolute(validate(SurveyConfig, content, "the command line"))


def _pose_source(config: SurveyConfig) -> tuple[PoseSource, catalogue.Listing]:
    name = config.stages.pose_source
    stage_class = registry.load([name])[name]
    if stage_class.kind != "pose_source":
        raise ConfigurationError(
            f"'{name}' is a {stage_class.kind}, not a pose_source",
            where="stages.pose_source",
            cure="see `slideframe plugins` for those of the right kind",
        )
    stage = validate(stage_class, config.plugins.get(name, {}), f"[plugins.{name}]")
    return cast(PoseSource, stage), catalogue.find(name)


def _resolved(config: SurveyConfig) -> dict[str, Any]:
    """Return the config as TOML content that means the same anywhere."""
    content = config.model_dump(mode="json", exclude_none=True)
    stage, _ = _pose_source(config)
    for name, value in stage:
        if isinstance(value, Path):
            content["plugins"][stage.name][name] = str(value.absolute())
    return content


def _deliver(out: Path, name: str, config: SurveyConfig, keyed: Keyed[Survey], computed: bool) -> list[str]:
    """Write report, cameras, recording and figures, and return the lines to print."""
    import tomli_w

    from slideframe import record
    from slideframe.quality.drawing import draw_maps
    from slideframe.quality.page import report_lines

    with storing(out), suppress(FileNotFoundError):
        (out / RESULT).unlink()
    appraisal = appraise_survey(keyed, config.region)
    maps = draw_maps(appraisal)
    write_report(out, name, keyed, appraisal, maps)
    left_out = write_cameras(keyed.value, out)
    figures = {"pose_source": survey_result(keyed, appraisal, computed)}
    toml = tomli_w.dumps(_resolved(config))
    with storing(out):
        (out / CONFIG).write_text(toml, encoding="utf-8")
        recording = record.Recording(out / RECORDING, out.name, active_tab=SURVEY_TAB)
        record.log_survey(recording.stream, keyed.value)
        record.log_survey_maps(recording.stream, maps)
        record.log_report(recording.stream, result_table(figures, []), toml)
        recording.close()
    write_result(out / RESULT, {"keys": {"pose_source": keyed.key}, **figures, "outputs": {"left_out": left_out}})
    return report_lines(appraisal, keyed.entry.manifest["figures"])
