"""Installed plugins: listed by their metadata alone, loaded only when chosen."""

import difflib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec

import pluggy

from slideframe import hookspecs
from slideframe.errors import MissingDependency, PluginConflict, PluginError, PluginNotFound
from slideframe.hookspecs import ENTRY_POINT_GROUP
from slideframe.stages import Stage

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
        kinds = [word.strip()[len(KIND_KEYWORD_PREFIX) :] for word in keywords if word.strip().startswith(KIND_KEYWORD_PREFIX)]
        listing = Listing(entry_point.name, kinds[0] if kinds else "", distribution.name, distribution.version, entry_point)
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


def load(names: Iterable[str]) -> dict[str, type[Stage]]:
    """Import the named plugins, and no other, and return their stage classes by name.

    Raises:
        PluginNotFound, PluginConflict: see `find`.
        PluginError: a plugin can't be imported or breaks the contract.
    """
    manager = pluggy.PluginManager("slideframe")
    manager.add_hookspecs(hookspecs)
    listings = {name: find(name) for name in names}
    for listing in listings.values():
        _register(manager, listing)
    offered = {stage.name: stage for stage in manager.hook.slideframe_stage()}
    return {name: offered[name] for name in listings}


def _register(manager: pluggy.PluginManager, listing: Listing) -> None:
    try:
        module = listing.entry_point.load()
        manager.register(module, name=listing.name)
    except (Exception, SystemExit) as error:  # foreign code: whatever it raises is reported with its name
        raise PluginError(
            f"{listing} can't be imported: {type(error).__name__}: {error}",
            where=listing.entry_point.value,
            cure=f"repair or reinstall it: pip install --force-reinstall {listing.distribution}",
        ) from error
    callers = manager.get_hookcallers(module) or []
    if not any(caller.name == "slideframe_stage" for caller in callers):
        raise _broken(listing, "has no hook 'slideframe_stage'")
    stage = module.slideframe_stage()
    if not (inspect.isclass(stage) and issubclass(stage, Stage)):
        raise _broken(listing, f"returned {stage!r}, which is no Stage class")
    if inspect.isabstract(stage):
        raise _broken(listing, f"leaves abstract: {', '.join(sorted(stage.__abstractmethods__))}")
    if getattr(stage, "name", None) != listing.name:
        raise _broken(listing, f"names its stage '{getattr(stage, 'name', None)}': it must equal the entry point's name")


def _broken(listing: Listing, how: str) -> PluginError:
    return PluginError(f"{listing} {how}", where=listing.entry_point.value, cure="see docs/writing_a_plugin.md")


def require_backend(stage: type[Stage] | Stage, listing: Listing) -> None:
    """Raise MissingDependency unless every package that the stage computes with can be imported."""
    for package in stage.backend:
        if find_spec(package) is None:
            raise MissingDependency(
                f"{listing} needs the package '{package}', which is not installed",
                where=f"stage '{stage.name}'",
                cure=f"pip install --upgrade {listing.distribution}",
            )
