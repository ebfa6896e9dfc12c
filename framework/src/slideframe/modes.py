"""The two modes of a run: presets over the same options, below whatever the config itself says.

`paper` reproduces Liang & Cheng 2026 as written; `engineering` is what a geotechnical engineer can defend: a frictional
law without a guessed friction angle, the scanned ground as a frictional collider, open sides with counted outflow,
stress in balance before the mass is let go, and an end at rest.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel

from slideframe import registry
from slideframe.config import Mode, RunConfig, StageChoice
from slideframe.errors import ConfigurationError, PluginConflict, PluginError, PluginNotFound
from slideframe.problem import kind_of, models_of

Table = dict[str, Any]

# What both take for soil that nothing else is known of: the paper's card but for its friction.
SOIL = {"density": 2000.0, "youngs_modulus": 5e7, "poisson_ratio": 0.3}


class Chosen(NamedTuple):
    """One option that the mode presets.

    Attributes:
        key: dotted.
        value: what the run has.
        preset: what the mode says.
    """

    key: str
    value: Any
    preset: Any


def apply_mode(content: Table) -> Table:
    """Return raw config content with what its `mode` presets filled in; without a mode, or with none known, as it is.

    Raises:
        ConfigurationError: the engineering mode is asked to guess a friction angle.
    """
    mode: Any = content.get("mode")
    if mode not in get_args(Mode):
        return content
    whole: Table = _over(_preset(mode, content), content, [RunConfig])
    return whole


def chosen(config: RunConfig) -> list[Chosen]:
    """Return the options that the config's mode presets, with what the run has of them."""
    if config.mode is None:
        return []
    content = config.model_dump(mode="json")
    return [
        Chosen(key, value, preset)
        for key, preset in _flat(_preset(config.mode, content))
        for value in _found(content, key.split("."))
    ]


def _preset(mode: Mode, content: Mapping[str, Any]) -> Table:
    preset = _paper() if mode == "paper" else _engineering(content)
    if plugins := dict(_of_plugins(mode, content)):
        preset["plugins"] = plugins
    return preset


def _paper() -> Table:
    return {
        "material": {"kind": "sand", "friction_match": "triaxial_compression", "friction_angle": 22.0, **SOIL},
        "boundary": {
            "sides": {"kind": "slip"},
            "floor": {"kind": "slip"},
            "terrain": {"kind": "open"},
            "domain": {"extent": "region"},
        },
        "simulation": {
            "gravity": [0.0, 0.0, -9.8],
            "particles_per_cell": 8,
            "transfer": {"kind": "apic"},
            "initial_stress": "none",
            "stop": "duration",
        },
    }


def _engineering(content: Mapping[str, Any]) -> Table:
    material = content.get("material")
    given = material if isinstance(material, Mapping) else {}
    elastic, angle = given.get("kind") == "elastic", given.get("friction_angle")
    if angle is None and not elastic:
        raise ConfigurationError(
            "mode = 'engineering' doesn't guess the soil's friction angle",
            where="material.friction_angle",
            cure="give it, in degrees: [material] friction_angle = 30, or --set material.friction_angle=30",
        )
    # rough contact of soil on the same soil; more than the soil's own friction would not be obeyed
    ground = {"kind": "stick"} if elastic else {"kind": "friction", "friction_angle": angle}
    return {
        "material": {"kind": "drucker_prager", "friction_match": "mohr_coulomb", **SOIL},
        "boundary": {
            "sides": {"kind": "open"},
            "floor": {"kind": "open"},
            "terrain": ground,
            "domain": {"extent": "terrain"},
        },
        "simulation": {
            "gravity": [0.0, 0.0, -9.81],
            "particles_per_cell": 8,
            "transfer": {"kind": "apic"},
            "initial_stress": "ramp",
            "stop": "rest",
        },
    }


def _of_plugins(mode: Mode, content: Mapping[str, Any]) -> Iterator[tuple[str, Table]]:
    """Give what the chosen plugins preset of their own options."""
    given = content.get("stages")
    names = StageChoice().names() | (given if isinstance(given, dict) else {})
    for name in names.values():
        with suppress(PluginError, PluginConflict, PluginNotFound):  # told when the crew is assembled
            if preset := registry.load([name])[name].presets.get(mode):
                yield name, dict(preset)


def _over(preset: Mapping[str, Any], given: Any, models: list[type[BaseModel]]) -> Any:
    """Return a table of raw content with the preset's values where it has none; `models` are what it may stand for."""
    if not isinstance(given, dict):
        return given
    kind = preset.get("kind")
    if kind is not None and given.get("kind", kind) != kind:
        # another law of soil has some keys in common, a wall of another kind has none
        members = [model for model in models if kind_of(model) == given["kind"]]
        preset = {
            key: preset[key] for model in members for key in preset if key in model.model_fields and key != "kind"
        }
    merged = dict(given)
    for key, value in preset.items():
        inner = [
            part
            for model in models
            if key in model.model_fields
            for part in models_of(model.model_fields[key].annotation)
        ]
        if key not in merged:
            merged[key] = value
        elif isinstance(value, Mapping):
            merged[key] = _over(value, merged[key], inner)
    return merged


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _found(table: Any, parts: list[str]) -> Iterator[Any]:
    """Give the value under a key, if there is one."""
    for part in parts:
        if not isinstance(table, Mapping) or part not in table:
            return
        table = table[part]
    yield table
