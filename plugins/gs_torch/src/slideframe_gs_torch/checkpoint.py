"""Training that was cut off goes on where it was."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters

FILE_NAME = "checkpoint.pt"
NUMBERS = ("start_count", "iteration", "seconds")


@dataclass
class State:
    """All that the next iteration depends on."""

    parameters: Parameters
    adam: Adam
    score: Tensor
    start_count: int
    iteration: int = 0
    seconds: float = 0.0


def save(state: State, folder: Path) -> None:
    """Write the state beside the last one, then replace it."""
    content = {
        "raw": {name: tensor.detach() for name, tensor in state.parameters.raw.items()},
        "mean": state.adam.mean,
        "square": state.adam.square,
        "steps": state.adam.steps,
        "score": state.score,
        **{name: getattr(state, name) for name in NUMBERS},
    }
    partial = folder / f"{FILE_NAME}.part"
    torch.save(content, partial)
    partial.replace(folder / FILE_NAME)


def load(folder: Path) -> State | None:
    """Return the saved state, or None where there is none."""
    path = folder / FILE_NAME
    if not path.exists():
        return None
    content = torch.load(path, weights_only=True)
    raw = {name: tensor.requires_grad_() for name, tensor in content["raw"].items()}
    adam = Adam(content["mean"], content["square"], content["steps"])
    return State(Parameters(raw), adam, content["score"], *(content[name] for name in NUMBERS))
