"""`slideframe init`: a commented config to start from, and its schema."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import tyro

from slideframe.commands.schema import config_schema
from slideframe.errors import ConfigurationError
from slideframe.store import storing

SCHEMA = "slideframe.schema.json"


@dataclass(frozen=True)
class InitOptions:
    """Write a commented config to start from, and the schema that lets editors complete it."""

    path: Annotated[Path, tyro.conf.Positional] = Path("slideframe.toml")
    """The file to write."""
    photographs: Path = Path("photographs")
    """Folder of the drone's photographs."""


def main(arguments: Sequence[str]) -> int:
    """Write both files; an existing config is never overwritten."""
    options = tyro.cli(InitOptions, args=list(arguments), prog="slideframe init")
    if options.path.exists():
        raise ConfigurationError("the file exists", where=str(options.path), cure="name another, or remove it")
    template = (files("slideframe.commands") / "template.toml").read_text(encoding="utf-8")
    with storing(options.path):
        options.path.parent.mkdir(parents=True, exist_ok=True)
        photographs = options.photographs.absolute().as_posix().replace("\\", "\\\\").replace('"', '\\"')
        options.path.write_text(template.replace("PHOTOGRAPHS", photographs), encoding="utf-8")
        schema = options.path.with_name(SCHEMA)
        schema.write_text(json.dumps(config_schema(), indent=1), encoding="utf-8")
    print(f"wrote {options.path} and {schema}; next:")
    print(f"  slideframe run {options.path} --until pose_source    # then set [region] from the recording's points")
    print(f"  slideframe run {options.path}")
    return 0
