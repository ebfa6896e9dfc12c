"""What every stage must hold, whatever it computes."""

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

from pydantic import ValidationError

from slideframe.catalogue import ENTRY_POINT_GROUP
from slideframe.stages import Stage


def check_options_survive_json(stage: Stage, scratch: Path) -> None:
    """Options written as JSON and read again make an equal stage."""
    again = type(stage).model_validate_json(stage.model_dump_json())
    assert again == stage, f"{stage!r} came back from JSON as {again!r}"


def check_unknown_options_are_refused(stage: Stage, scratch: Path) -> None:
    """A misspelt option is an error, never ignored."""
    try:
        type(stage).model_validate({**stage.model_dump(), "frction_angle": 1})
    except ValidationError:
        return
    raise AssertionError("the unknown option 'frction_angle' was accepted; keep Stage's extra='forbid'")


def check_options_are_immutable(stage: Stage, scratch: Path) -> None:
    """A stage is a value: setting an option afterwards fails."""
    for name in type(stage).model_fields:
        try:
            setattr(stage, name, getattr(stage, name))
        except ValidationError:
            continue
        raise AssertionError(f"option '{name}' can be set after construction; keep Stage's frozen=True")


def check_options_are_described(stage: Stage, scratch: Path) -> None:
    """Every option says what it is, since the command line and the docs show that text."""
    missing = [name for name, field in type(stage).model_fields.items() if not field.description]
    assert not missing, f"options without Field(description=...): {', '.join(missing)}"


def check_name_is_its_entry_point(stage: Stage, scratch: Path) -> None:
    """The installed entry point of the stage's name offers this class."""
    found = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name == stage.name]
    assert found, f"no installed distribution has the entry point '{stage.name}' in group '{ENTRY_POINT_GROUP}'"
    offered = found[0].load().slideframe_stage()
    assert offered is type(stage), f"entry point '{stage.name}' offers {offered}, not {type(stage)}"


def check_imports_without_its_backend(stage: Stage, scratch: Path) -> None:
    """Importing the stage's module and making the stage imports none of the packages it computes with."""
    program = (
        "import importlib, sys\n"
        f"for name in {stage.backend!r}: sys.modules[name] = None\n"
        f"module = importlib.import_module({type(stage).__module__!r})\n"
        f"stage = module.{type(stage).__qualname__}.model_validate_json({stage.model_dump_json()!r})\n"
        "stage.model_json_schema()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"with {', '.join(stage.backend)} absent, importing fails:\n{done.stderr}"
