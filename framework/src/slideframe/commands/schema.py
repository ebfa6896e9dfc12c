"""`slideframe schema`: every key of the config, as a JSON Schema or as a page to read."""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, get_origin

import tyro
from pydantic import BaseModel

from slideframe import catalogue, registry
from slideframe.config import RunConfig
from slideframe.errors import PluginConflict, PluginError
from slideframe.problem import kind_of, models_of
from slideframe.stages import Stage


@dataclass(frozen=True)
class SchemaOptions:
    """Print every key of the config, for the installed plugins.

    As a JSON Schema, name it in the first line of a config for completion in editors: #:schema ./slideframe.schema.json
    """

    markdown: bool = False
    """Print tables to read instead of a JSON Schema."""


def main(arguments: Sequence[str]) -> int:
    """Print the schema; a plugin that can't be imported is left out and named on stderr."""
    options = tyro.cli(SchemaOptions, args=list(arguments), prog="slideframe schema")
    print("\n".join(markdown_lines()) if options.markdown else json.dumps(config_schema(), indent=1))
    return 0


def config_schema() -> dict[str, Any]:
    """Return the JSON Schema of a config, the installed plugins' options included."""
    schema = RunConfig.model_json_schema()
    tables = {stage.name: stage.model_json_schema() for stage in _importable_stages()}
    for table in tables.values():
        schema["$defs"] |= table.pop("$defs", {})  # references are meant from the root
    schema["properties"]["plugins"] = {"type": "object", "properties": tables}
    return schema


def markdown_lines() -> Iterator[str]:
    """Give one table for each table of the config."""
    yield from _tables("", RunConfig, without=("plugins",))
    for stage in _importable_stages():
        yield from _tables(f"plugins.{stage.name}", stage)


def _tables(key: str, model: type[BaseModel], without: tuple[str, ...] = (), member_of: int = 1) -> Iterator[str]:
    """Give the model's own keys, then the tables inside it; the members of a union are told apart by their kind."""
    schema = model.model_json_schema()["properties"]
    inner, rows = {}, []
    for name, field in model.model_fields.items():
        if members := models_of(field.annotation):
            # a table may be repeated
            inner[f"{name}[]" if get_origin(field.annotation) is tuple else name] = members
        elif name not in without:
            default = "required" if field.is_required() else json.dumps(schema[name].get("default"))
            choices = " \\| ".join(map(json.dumps, schema[name].get("enum", [])))
            meaning = "; ".join(filter(None, [field.description, choices]))
            rows.append(f"| `{name}` | {default} | {meaning} |")
    if rows:
        kind = f' with kind = "{kind_of(model)}"' if member_of > 1 else ""
        table = f"[[{key[:-2]}]]" if key.endswith("[]") else f"[{key}]"
        yield from (f"## {table}{kind}" if key else "## Top level", "", (model.__doc__ or "").splitlines()[0], "")
        yield from ("| key | default | meaning |", "|---|---|---|", *rows, "")
    for name, members in inner.items():
        for member in members:
            yield from _tables(f"{key}.{name}".lstrip("."), member, member_of=len(members))


def _importable_stages() -> Iterator[type[Stage]]:
    for name in sorted({listing.name for listing in catalogue.installed()}):
        try:
            yield registry.load([name])[name]
        except (PluginError, PluginConflict) as error:
            print(f"left out: {error}", file=sys.stderr)
