"""`slideframe check NAME`: does a plugin import, keep its contract and find its backend?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro

from slideframe import catalogue, registry


@dataclass(frozen=True)
class CheckOptions:
    """Import one plugin and check its contract and its backend."""

    name: Annotated[str, tyro.conf.Positional]
    """The plugin's name, as `slideframe plugins` lists it."""


def main(arguments: Sequence[str]) -> int:
    """Check, and print the plugin's options."""
    options = tyro.cli(CheckOptions, args=list(arguments), prog="slideframe check")
    listing = catalogue.find(options.name)
    stage = registry.load([options.name])[options.name]
    registry.require_backend(stage, listing)
    print(f"{listing}: a {stage.kind}, on {' or '.join(sorted(stage.devices))}; contract and backend are in order")
    for name, field in stage.model_fields.items():
        default = "required" if field.is_required() else repr(field.get_default(call_default_factory=True))
        print(f"  {name} = {default}    {field.description or ''}".rstrip())
    return 0
