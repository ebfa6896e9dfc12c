"""`slideframe run`: two passes over the command line.

The first finds the config and the stages; the second parses every option of the config that they make up.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from slideframe import pipeline
from slideframe.bench import Bench, ReachedGoal
from slideframe.commands.demo_survey import demo_config, prepare_demo_survey
from slideframe.commands.key_flags import has_key_flags, own_arguments, parse_key_flags
from slideframe.commands.progress import Silent, Watch, print_plan, print_result
from slideframe.config import STAGE_KINDS, Mode, RunConfig, absolute, apply_override, read_toml, validate
from slideframe.crew import Crew, assemble
from slideframe.device import parse_device
from slideframe.errors import SlideframeError, StoreError
from slideframe.formats.video import require_encoder
from slideframe.modes import apply_mode
from slideframe.run_folder import LOG, JsonLines, RunFolder
from slideframe.stages import StageKind
from slideframe.store import Store
from slideframe.survey_folder import report_on

_log = logging.getLogger("slideframe")


@dataclass(frozen=True)
class RunOptions:
    """Carry photographs to a moving picture of the slope's failure.

    Without CONFIG the embedded demo runs. Precedence: plugin defaults < CONFIG < command line.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """TOML file; see `slideframe init`."""
    mode: Mode | None = None
    """paper or engineering: presets below the keys that are given."""
    pose_source: str | None = None
    """Plugin that finds the cameras."""
    reconstructor: str | None = None
    """Plugin that makes the splats."""
    volume_filler: str | None = None
    """Plugin that fills the ground."""
    solver: str | None = None
    """Plugin that moves the mass."""
    renderer: str | None = None
    """Plugin that draws the film."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    out: Path | None = None
    """Run folder; by default runs/CONFIG-SOLVER."""
    store: Path | None = None
    """Folder of stored results, shared by runs; by default `store` beside the run folder."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Override any key: --set material.friction_angle=30. Also for plugins that are not chosen."""
    until: StageKind | None = None
    """Stop after this stage."""
    film: bool = True
    """Write film.mp4."""
    dry_run: bool = False
    """Tell which stages have their results and which would compute, then stop."""


def main(arguments: Sequence[str]) -> int:
    """Parse, prepare and run."""
    options = tyro.cli(RunOptions, args=own_arguments(arguments, RunOptions), prog="slideframe run")
    config = read_config(options)
    if has_key_flags(arguments, RunOptions):
        config = _parse_tuning(options, config, arguments)
    return _run(options, config)


def read_config(options: RunOptions) -> RunConfig:
    """Read the config, or the demo's where none is named, with its overrides and the stages named by flags."""
    content = demo_config() if options.config is None else read_toml(options.config)
    for assignment in options.set:
        apply_override(content, assignment)
    for kind in STAGE_KINDS:
        if name := getattr(options, kind):
            apply_override(content, f'stages.{kind}="{name}"')
    if options.mode:
        content["mode"] = options.mode
    content = apply_mode(content)
    return absolute(validate(RunConfig, content, str(options.config or "the embedded demo")))


def _parse_tuning(options: RunOptions, config: RunConfig, arguments: Sequence[str]) -> RunConfig:
    """Parse again, with a flag for every key of the problem and every option of the chosen plugins."""
    fields = {
        name: field for name, field in RunConfig.model_fields.items() if name not in ("mode", "stages", "plugins")
    }
    keys = {name: (field.annotation, getattr(config, name)) for name, field in fields.items()}
    changed, tuning = parse_key_flags(options, keys, assemble(config).stages(), arguments, "run CONFIG")
    return absolute(RunConfig(**changed, mode=config.mode, stages=config.stages, plugins=dict(config.plugins) | tuning))


def _run(options: RunOptions, config: RunConfig) -> int:
    out = options.out or Path("runs") / f"{config_name(options.config)}-{config.stages.solver}"
    store = Store(options.store or out.parent / "store")
    crew = assemble(config)
    device = parse_device(options.device)
    if options.film:
        require_encoder("h264", "av1")
    if options.config is None:
        prepare_demo_survey()
    crew.preflight(config, device)
    plan = Bench(store, crew.listings, device, config.seed, Silent(), dry=True, until=options.until)
    _carry_out(config, crew, plan)
    if options.dry_run:
        print_plan(plan)
        return 0
    run_folder = RunFolder(out)
    with run_folder.locked():
        if not plan.computed and run_folder.is_current(config, plan, options.film):
            print(f"nothing to do: {out} holds this run")
            return 0
        store.open()
        run_folder.open(config)
        with logging_to(run_folder.folder / LOG), Watch() as watch:
            bench = Bench(store, crew.listings, device, config.seed, watch, until=options.until)
            try:
                _carry_out(config, crew, bench)
            except SlideframeError as error:
                _log.error("%s", error, exc_info=True)
                if bench.results and not isinstance(error, StoreError):
                    _deliver_what_there_is(run_folder, config, bench, watch)
                raise
            run_folder.deliver(config, bench, options.film, watch.delivering)
    if options.until == "pose_source":
        print("\n".join([*report_on(bench.results["pose_source"], config.region), ""]))
    print_result(out)
    return 0


def _deliver_what_there_is(run_folder: RunFolder, config: RunConfig, bench: Bench, watch: Watch) -> None:
    """Write the finished stages' outputs beside an error; a fault in that never hides the error itself."""
    try:
        run_folder.deliver(config, bench, False, watch.delivering)
    except Exception:
        _log.exception("the outputs of the finished stages could not be written")


def _carry_out(config: RunConfig, crew: Crew, bench: Bench) -> None:
    with suppress(ReachedGoal):
        pipeline.run(config, crew, bench)


def config_name(path: Path | None) -> str:
    """Return the name that a config gives its runs."""
    return "demo" if path is None else path.stem


@contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """Send everything that slideframe logs to a JSON-lines file."""
    handler = JsonLines(path)
    _log.addHandler(handler)
    _log.setLevel(logging.INFO)
    _log.propagate = False
    try:
        yield
    finally:
        _log.removeHandler(handler)
        handler.close()
