"""Chosen plugins, imported and held to the contract."""

import inspect
from collections.abc import Iterable
from importlib.util import find_spec

import pluggy

from slideframe import hookspecs
from slideframe.catalogue import Listing, find
from slideframe.errors import MissingDependency, PluginError
from slideframe.stages import Stage


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
    try:
        stage = module.slideframe_stage()
    except Exception as error:
        raise _broken(listing, f"fails in its hook: {type(error).__name__}: {error}") from error
    if not listing.name.isidentifier():
        raise _broken(listing, "must have a name of letters, digits and underscores, to be a key and a flag")
    if not (inspect.isclass(stage) and issubclass(stage, Stage)):
        raise _broken(listing, f"returned {stage!r}, which is no Stage class")
    if inspect.isabstract(stage):
        raise _broken(listing, f"leaves abstract: {', '.join(sorted(stage.__abstractmethods__))}")
    if getattr(stage, "name", None) != listing.name:
        raise _broken(
            listing, f"names its stage '{getattr(stage, 'name', None)}': it must equal the entry point's name"
        )


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
