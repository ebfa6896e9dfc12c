"""The second pass over a command line: a flag for every key of the problem and every option of the chosen plugins.

The first pass finds the config and the stages, which decide what flags there are (decision 3).
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import tyro

from slideframe.errors import ConfigurationError
from slideframe.stages import Stage


def own_arguments(arguments: Sequence[str], options: type[Any]) -> list[str]:
    """Leave out the flags that aren't fields of `options`, a dataclass, with their values, and the call for help."""
    names = [field.name.replace("_", "-") for field in dataclasses.fields(options)]
    own = {f"--{name}" for name in names} | {f"--no-{name}" for name in names}
    kept, keep = [], True
    for argument in arguments:
        if argument.startswith("--"):
            keep = argument.partition("=")[0].replace("_", "-") in own
        if keep and argument not in ("-h", "--help"):
            kept.append(argument)
    return kept


def has_key_flags(arguments: Sequence[str], options: type[Any]) -> bool:
    """Tell whether there is anything for the second pass: flags of single keys, or the call for help."""
    return bool(set(arguments) - set(own_arguments(arguments, options)))


def parse_key_flags(
    options: Any, keys: Mapping[str, tuple[Any, Any]], stages: Iterable[Stage], arguments: Sequence[str], usage: str
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Parse anew with every key; return the problem's keys and the plugins' tables.

    Args:
        options: what the first pass found, an instance of a dataclass.
        keys: annotation and present value of the problem's keys, by name.
        stages: the chosen ones, as configured so far.
        arguments: the whole command line.
        usage: the command's name and what must follow, for messages: "run CONFIG".

    Raises:
        ConfigurationError: a flag of the first pass stands behind those of keys, where it would be taken for a value.
    """
    command, first = usage.split()
    tables = {stage.name: stage for stage in stages}
    plugins = dataclasses.make_dataclass(
        "Plugins", [(name, type(stage), stage) for name, stage in tables.items()], frozen=True
    )
    everything = dataclasses.make_dataclass(
        "Everything",
        [
            ("options", Annotated[type(options), tyro.conf.arg(name="")]),
            *[
                (name, Annotated[annotation, tyro.conf.arg(name=name)], value)
                for name, (annotation, value) in keys.items()
            ],
            ("plugins", plugins, plugins()),
        ],
        frozen=True,
    )
    everything.__doc__ = type(options).__doc__
    # a nested optional model would else become a subcommand, whose order matters
    markers = (tyro.conf.AvoidSubcommands,)
    parsed: Any = tyro.cli(everything, args=list(arguments), prog=f"slideframe {command}", config=markers)
    if parsed.options != options:
        raise ConfigurationError(
            f"{first} and the command's own flags must stand before the flags of single keys",
            where=f"slideframe {command} {' '.join(arguments)}",
            cure=f"write slideframe {usage} --set ... --table.key VALUE ...",
        )
    tuning = {name: getattr(parsed.plugins, name).model_dump(mode="json") for name in tables}
    return {name: getattr(parsed, name) for name in keys}, tuning
