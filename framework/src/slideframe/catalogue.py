"""Installed plugins by their metadata alone: nothing of them, and no NumPy, is imported."""

import difflib
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from slideframe.errors import PluginConflict, PluginNotFound

ENTRY_POINT_GROUP = "slideframe"
KIND_KEYWORD_PREFIX = "slideframe-"


@dataclass(frozen=True)
class Listing:
    """One installed plugin as its metadata describes it; nothing of it has been imported."""

    name: str
    kind: str
    distribution: str
    version: str
    entry_point: EntryPoint

    def __str__(self) -> str:
        return f"plugin '{self.name}' of distribution {self.distribution} {self.version}"


def installed() -> list[Listing]:
    """List every plugin by entry-point metadata, sorted by kind and name."""
    found: dict[tuple[str, str], Listing] = {}
    for entry_point in entry_points(group=ENTRY_POINT_GROUP):
        distribution = entry_point.dist
        if distribution is None:
            continue
        keywords = (distribution.metadata["Keywords"] or "").split(",")
        kinds = [
            word.strip()[len(KIND_KEYWORD_PREFIX) :]
            for word in keywords
            if word.strip().startswith(KIND_KEYWORD_PREFIX)
        ]
        listing = Listing(
            entry_point.name, kinds[0] if kinds else "", distribution.name, distribution.version, entry_point
        )
        # a distribution can stand on sys.path twice (editable install beside a built one): the first is imported
        found.setdefault((listing.name, listing.distribution), listing)
    return sorted(found.values(), key=lambda listing: (listing.kind, listing.name, listing.distribution))


def find(name: str) -> Listing:
    """Return the one installed plugin of that name.

    Raises:
        PluginNotFound: none offers it; the message lists those that are there.
        PluginConflict: two distributions claim it.
    """
    everything = installed()
    matches = [listing for listing in everything if listing.name == name]
    if not matches:
        names = sorted({listing.name for listing in everything})
        near = difflib.get_close_matches(name, names, n=1)
        raise PluginNotFound(
            f"no installed plugin is named '{name}'",
            where=f"installed: {', '.join(names) or 'none'}",
            cure=f"did you mean '{near[0]}'?" if near else "install the plugin's distribution with pip",
        )
    if len(matches) > 1:
        claimants = " and ".join(f"{listing.distribution} {listing.version}" for listing in matches)
        raise PluginConflict(
            f"two distributions offer a plugin named '{name}': {claimants}",
            where=f"entry-point group '{ENTRY_POINT_GROUP}'",
            cure="uninstall one of them",
        )
    return matches[0]
