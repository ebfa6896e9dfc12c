"""One run's configuration: the problem, the choice of stages, and each plugin's tuning."""

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import tomli_w
from pydantic import BaseModel, Field, ValidationError

from slideframe import faults, registry
from slideframe.errors import ConfigurationError, PluginConflict, PluginError, PluginNotFound
from slideframe.outputs import Outputs
from slideframe.problem import (
    Boundary,
    FillingProblem,
    Material,
    OrbitView,
    ProblemModel,
    ReferenceGround,
    Region,
    Simulation,
    SimulationProblem,
    Site,
    View,
    models_of,
)
from slideframe.stages import StageKind

Model = TypeVar("Model", bound=BaseModel)
Mode = Literal["paper", "engineering"]
STAGE_KINDS: tuple[StageKind, ...] = get_args(StageKind)


class StageChoice(ProblemModel):
    """The plugin that does each stage, by name."""

    pose_source: str = "pose_rtk"
    reconstructor: str = "gs_torch"
    volume_filler: str = "fill_poisson"
    solver: str = "mpm_warp"
    renderer: str = "render_gs"

    def names(self) -> dict[StageKind, str]:
        """Return the choice by kind, in the order of the pipeline."""
        return {kind: getattr(self, kind) for kind in STAGE_KINDS}


class RunConfig(ProblemModel):
    """Everything that decides a run's result."""

    mode: Mode | None = Field(
        default=None,
        description="presets of many keys, below those that are given: 'paper' as in Liang & Cheng 2026, 'engineering' "
        "as can be defended (docs/modes.md); none: each key's own default",
    )
    site: Site
    region: Region
    material: Material
    boundary: Boundary = Boundary()
    simulation: Simulation
    view: View = OrbitView()
    reference_ground: ReferenceGround | None = None
    outputs: Outputs = Outputs()
    stages: StageChoice = StageChoice()
    plugins: dict[str, dict[str, Any]] = Field(default={}, description="options of each plugin, by its name")
    seed: int = Field(default=0, ge=0, description="seed of every random choice")

    def problem_of(self, kind: StageKind) -> ProblemModel:
        """Return the part of the problem that a stage of that kind is given."""
        problems: dict[StageKind, ProblemModel] = {
            "pose_source": self.site,
            "reconstructor": self.site,
            "volume_filler": self.filling_problem,
            "solver": self.simulation_problem,
            "renderer": self.view,
        }
        return problems[kind]

    @property
    def filling_problem(self) -> FillingProblem:
        """What the volume filler is asked for."""
        return FillingProblem(region=self.region, particle_spacing=self.simulation.particle_spacing)

    @property
    def simulation_problem(self) -> SimulationProblem:
        """What the solver is asked for."""
        return SimulationProblem(material=self.material, boundary=self.boundary, simulation=self.simulation)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a config file; relative paths in it are meant from the file's folder, those of plugins' options too.

    Raises:
        ConfigurationError: the file is absent or not TOML.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(
            f"the config can't be read: {error.strerror}", where=str(path), cure="name an existing TOML file"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            f"the config is not TOML: {error}", where=str(path), cure="mend the line it names"
        ) from error
    _resolve_paths(content, [RunConfig], path.parent)
    for name, table in content.get("plugins", {}).items() if isinstance(content.get("plugins"), dict) else ():
        with suppress(PluginError, PluginConflict, PluginNotFound):  # told when the crew is assembled
            _resolve_paths(table, [registry.load([name])[name]], path.parent)
    return content


def absolute(config: Model) -> Model:
    """Return the config with its relative paths, meant from the current folder, so that it means the same anywhere."""
    content = config.model_dump(mode="json")
    _resolve_paths(content, [type(config)], Path.cwd())
    return type(config).model_validate(content)


def _resolve_paths(table: object, models: list[type[BaseModel]], folder: Path) -> None:
    """Make the relative paths in a table of raw content absolute; `models` are what the table may stand for."""
    if not isinstance(table, dict):
        return
    for key, value in table.items():
        annotations = [model.model_fields[key].annotation for model in models if key in model.model_fields]
        if isinstance(value, str) and any(_admits_path(annotation) for annotation in annotations):
            table[key] = str((folder / Path(value).expanduser()).resolve())
        inner = [model for annotation in annotations for model in models_of(annotation)]
        for item in value if isinstance(value, list) else [value]:
            _resolve_paths(item, inner, folder)


def _admits_path(annotation: Any) -> bool:
    return annotation is Path or any(map(_admits_path, get_args(annotation)))


def write_toml(config: RunConfig, path: Path) -> None:
    """Write the resolved config, so that it runs the same again."""
    path.write_text(tomli_w.dumps(_without_none(config.model_dump(mode="json"))), encoding="utf-8")


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def apply_override(content: dict[str, Any], assignment: str) -> None:
    """Apply `dotted.key=value` to raw config content; the value is read as TOML, else as a bare string.

    Raises:
        ConfigurationError: there is no `=`, or a part of the key is not a table.
    """
    key, equals, text = assignment.partition("=")
    if not equals or not key.strip():
        raise ConfigurationError(f"'{assignment}' is no assignment", where="--set", cure="write --set table.key=value")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *tables, last = key.strip().split(".")
    for table in tables:
        content = content.setdefault(table, {})
        if not isinstance(content, dict):
            raise ConfigurationError(
                f"'{table}' is no table", where=f"--set {assignment}", cure="see slideframe schema"
            )
    content[last] = value


def validate(model: type[Model], content: Mapping[str, Any], where: str) -> Model:
    """Build a model from raw content.

    Raises:
        ConfigurationError: one line for each fault, with key, rule and, where a key is unknown, the nearest known one.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        found = error.errors()
        raise ConfigurationError(
            "\n".join(faults.describe(model, fault) for fault in found), where=where, cure=faults.cure(model, found)
        ) from error
