"""`slideframe plugins`: what is installed, by metadata alone."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import tyro

from slideframe import catalogue


@dataclass(frozen=True)
class PluginsOptions:
    """List installed plugins without importing them."""

    json: bool = False
    """Print JSON."""


def main(arguments: Sequence[str]) -> int:
    """Print the list."""
    options = tyro.cli(PluginsOptions, args=list(arguments), prog="slideframe plugins")
    listings = catalogue.installed()
    claims = Counter(listing.name for listing in listings)
    rows = [
        {
            "kind": listing.kind,
            "name": listing.name,
            "distribution": listing.distribution,
            "version": listing.version,
            "module": listing.entry_point.value,
            "conflict": claims[listing.name] > 1,
        }
        for listing in listings
    ]
    if options.json:
        print(json.dumps(rows, indent=1))
        return 0
    for row in rows:
        conflict = "  CONFLICT: the name is claimed twice" if row["conflict"] else ""
        print(
            f"{row['kind'] or '(kind unknown)':<15} {row['name']:<15} {row['distribution']} {row['version']}{conflict}"
        )
    return 0
