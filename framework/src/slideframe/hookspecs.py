"""The one hook. A plugin's module implements it in six lines; see docs/writing_a_plugin.md."""

import pluggy

from slideframe.stages import Stage

hookspec = pluggy.HookspecMarker("slideframe")
hookimpl = pluggy.HookimplMarker("slideframe")


@hookspec
def slideframe_stage() -> type[Stage]:  # type: ignore[empty-body]
    """Return the stage this plugin implements."""
