"""Every error slideframe raises on purpose, with the exit code of the command line.

SlideframeError                 4
├── ConfigurationError          2   the config file, a flag or an option is wrong
│   ├── PluginNotFound          2   no installed distribution offers the stage
│   └── PluginConflict          2   two distributions claim one name
├── InputError                  2   photographs or other input files can't be used
├── MissingDependency           3   a backend, a system library or a device is absent
├── PluginError                 3   a plugin can't be imported or breaks the contract
├── StageFailed                 4   a stage stopped while it computed
└── StoreError                  4   results can't be written or read
"""


class SlideframeError(Exception):
    """An error that says what is wrong, where, and how to cure it."""

    exit_code = 4

    def __init__(self, what: str, *, where: str = "", cure: str = "") -> None:
        """Keep the three parts apart, so that a caller can show or log them singly."""
        super().__init__(what)
        self.what = what
        self.where = where
        self.cure = cure

    def __str__(self) -> str:
        lines = [self.what]
        if self.where:
            lines.append(f"  where: {self.where}")
        if self.cure:
            lines.append(f"  cure:  {self.cure}")
        return "\n".join(lines)


class ConfigurationError(SlideframeError):
    """The config file, a command-line flag or a plugin option is wrong."""

    exit_code = 2


class PluginNotFound(ConfigurationError):
    """No installed distribution offers a stage of that name."""


class PluginConflict(ConfigurationError):
    """Two distributions claim one stage name."""


class InputError(SlideframeError):
    """Photographs or other input files can't be used."""

    exit_code = 2


class MissingDependency(SlideframeError):
    """A backend, a system library or a device is absent."""

    exit_code = 3


class PluginError(SlideframeError):
    """A plugin can't be imported or breaks the contract of its stage."""

    exit_code = 3


class StageFailed(SlideframeError):
    """A stage stopped while it computed; products finished before it are kept."""


class StoreError(SlideframeError):
    """Results can't be written or read."""
