"""What a solver needs to go on after it was killed: its state every so many frames, in its scratch folder."""

import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.stages import Context
from slideframe.store import storing

State = Mapping[str, npt.NDArray[Any]]

# The last one, and the one before it for the case that frames after it turn out damaged.
KEPT = 2


@dataclass(frozen=True)
class Checkpoints:
    """The checkpoints of one stream.

    Attributes:
        context: the stage's; its scratch folder holds the checkpoints.
        every: frames from one to the next; 0: none are written.
    """

    context: Context
    every: int

    def latest(self) -> tuple[int, State] | None:
        """Return the frame and the state of the newest checkpoint up to which all frames are stored, if there is one.

        The stream then goes on after that frame (`Context.resume`).
        """
        for frame, path in sorted(self._paths().items(), reverse=True):
            if frame < self.context.stored:
                try:
                    with np.load(path, allow_pickle=False) as arrays:
                        state = {name: arrays[name] for name in arrays.files}
                except (OSError, ValueError, KeyError, zipfile.BadZipFile):
                    continue  # damaged: an older one will do
                self.context.resume(frame + 1)
                return frame, state
        return None

    def is_due(self, frame: int) -> bool:
        """Whether a checkpoint belongs after this frame."""
        return bool(self.every) and frame % self.every == 0

    def write(self, frame: int, state: State) -> None:
        """Keep the state after `frame`, which must be stored by now: a generator goes on once its item is."""
        path = self._path(frame)
        partial = path.with_suffix(".partial")
        with storing(path):
            with partial.open("wb") as stream:
                np.savez(stream, allow_pickle=False, **dict(state))
                stream.flush()
                os.fsync(stream.fileno())
            partial.rename(path)
            for old in sorted(self._paths())[:-KEPT]:
                self._path(old).unlink()

    def _path(self, frame: int) -> Path:
        return self.context.scratch / f"after-frame-{frame:06d}.npz"

    def _paths(self) -> dict[int, Path]:
        paths = self.context.scratch.glob("after-frame-*.npz")
        return {int(path.stem.rpartition("-")[2]): path for path in paths}
