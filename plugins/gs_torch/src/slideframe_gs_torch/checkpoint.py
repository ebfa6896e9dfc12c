"""Training that was cut off goes on where it was."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import torch
from torch import Tensor

from slideframe.stages import Context
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters

FILE_NAME, PARTIAL_NAME = "checkpoint.pt", "checkpoint.pt.part"
NUMBERS = ("start_count", "iteration", "settled", "seconds", "curve")


@dataclass
class State:
    """All that the next iteration depends on.

    Attributes:
        parameters: the splats.
        adam: their running moments.
        score: (splat, ...), what the way of densifying has observed.
        start_count: number of splats at the start.
        exposures: of the photographs shown.
        iteration: iterations done.
        settled: whether more of them would gain little.
        seconds: time that they took.
        curve: (iteration, seconds, held-out PSNR in dB), each time that it was measured on the way.
    """

    parameters: Parameters
    adam: Adam
    score: Tensor
    start_count: int
    exposures: Exposures
    iteration: int = 0
    settled: bool = False
    seconds: float = 0.0
    curve: list[tuple[int, float, float]] = field(default_factory=list)


def save(state: State, folder: Path) -> None:
    """Write the state beside the last one, then replace it."""
    content = {
        "raw": state.parameters.raw,
        "mean": state.adam.mean,
        "square": state.adam.square,
        "steps": state.adam.steps,
        "score": state.score,
        "exposures": {item.name: getattr(state.exposures, item.name) for item in fields(Exposures)},
        **{name: getattr(state, name) for name in NUMBERS},
    }
    partial = folder / PARTIAL_NAME
    torch.save(content, partial)
    partial.replace(folder / FILE_NAME)


class Writer:
    """Writes checkpoints; a disk without room for them costs the checkpoints, not the training."""

    def __init__(self, context: Context) -> None:
        """Take the folder, and whom to warn."""
        self._context, self._works = context, True

    def save(self, state: State) -> None:
        """Write the state, unless that failed before."""
        if not self._works:
            return
        try:
            save(state, self._context.scratch)
        except (OSError, RuntimeError) as error:  # torch's writer tells of a full disk by the latter
            self._works = False
            (self._context.scratch / PARTIAL_NAME).unlink(missing_ok=True)  # what follows needs the room
            reason = str(error).splitlines()[0]
            self._context.warn(
                f"no checkpoint could be written to {self._context.scratch} ({reason}): training goes on without, and "
                "would start anew if it were cut off"
            )


def load(context: Context) -> State | None:
    """Return the saved state, or None where there is none, or, with a warning, none that can be read."""
    path = context.scratch / FILE_NAME
    if not path.exists():
        return None
    try:
        content: dict[str, Any] = torch.load(path, weights_only=True)
        adam = Adam(content["mean"], content["square"], content["steps"])
        parameters, exposures = Parameters(content["raw"]), Exposures(**content["exposures"])
        return State(
            parameters, adam, content["score"], exposures=exposures, **{name: content[name] for name in NUMBERS}
        )
    except (OSError, RuntimeError, EOFError, KeyError, TypeError, UnpicklingError) as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        context.warn(f"the checkpoint {path} can't be read ({reason}): training starts anew")
        return None
