"""The command line. Each command imports what it needs when it is called, so that `--help` stays quick."""

import difflib
import importlib
import sys
from collections.abc import Sequence

from slideframe import __version__
from slideframe.errors import ConfigurationError, SlideframeError

INTERRUPTED = 130

COMMANDS = {
    "run": "carry photographs to a moving picture of the slope's failure",
    "survey": "locate the cameras and tell whether to fly again",
    "plugins": "list installed plugins without importing them",
    "check": "import one plugin and check its contract and its backend",
    "schema": "print a JSON Schema of the config for the installed plugins",
    "view": "open a run's recording in the rerun viewer",
    "verify": "check solvers against closed-form solutions and measurements",
    "compare": "print how far two runs of one problem agree",
    "export": "write a run's splats, cameras or pictures for other programs",
    "doctor": "report what this machine offers and lacks",
    "init": "write a commented config to start from",
    "demo-survey": "write the embedded demo's photographs",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; see errors.py, and 130 when interrupted."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_help())
        return 0
    if arguments[0] == "--version":
        print(f"slideframe {__version__}")
        return 0
    try:
        name, *rest = arguments
        if name not in COMMANDS:
            near = difflib.get_close_matches(name, COMMANDS, n=1)
            raise ConfigurationError(
                f"unknown command '{name}'", cure=f"did you mean '{near[0]}'?" if near else "see slideframe --help"
            )
        command = importlib.import_module(f"slideframe.commands.{name.replace('-', '_')}")
        return int(command.main(rest))
    except SlideframeError as error:
        print(f"slideframe: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("\nslideframe: interrupted; the same command goes on from the last finished stage", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        return 0


def _help() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {what}" for name, what in COMMANDS.items()]
    return "\n".join(
        [
            "usage: slideframe COMMAND [OPTIONS]",
            "",
            *lines,
            "",
            "slideframe COMMAND --help explains a command's options.",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
