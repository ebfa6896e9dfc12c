"""A finished run, opened again: its configuration, and its products from the store."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from slideframe.bench import PRODUCT_OF
from slideframe.config import RunConfig, validate
from slideframe.errors import InputError
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey
from slideframe.run_folder import CONFIG, RESULT
from slideframe.showing import Showing
from slideframe.stages import StageKind
from slideframe.store import Store


@dataclass(frozen=True)
class StoredRun:
    """The products of a run folder, each read when asked for.

    Attributes:
        folder: the run's.
        overlay: write time, scale bar and legend on the film's pictures, whatever the config says.
    """

    folder: Path
    overlay: bool = False

    @cached_property
    def config(self) -> RunConfig:
        """The resolved configuration."""
        config = validate(RunConfig, self._result["outputs"]["config"], str(self.folder / RESULT))
        if not self.overlay:
            return config
        return config.model_copy(update={"outputs": config.outputs.model_copy(update={"overlay": True})})

    def has(self, kind: StageKind) -> bool:
        """Whether the run came so far as that stage."""
        return kind in self._result.get("keys", {})

    @property
    def survey(self) -> Survey:
        """Where each photograph was taken."""
        return self._product("pose_source")  # type: ignore[no-any-return]

    @property
    def splats(self) -> SplatCloud:
        """The reconstruction."""
        return self._product("reconstructor")  # type: ignore[no-any-return]

    @property
    def filling(self) -> Filling:
        """The soil."""
        return self._product("volume_filler")  # type: ignore[no-any-return]

    @property
    def motion(self) -> Sequence[ParticleFrame]:
        """The frames of the motion."""
        return self._product("solver")  # type: ignore[no-any-return]

    @property
    def film(self) -> Sequence[Picture]:
        """The pictures of the film."""
        return self._product("renderer")  # type: ignore[no-any-return]

    @property
    def showing(self) -> Showing:
        """The film as people see it."""
        return Showing(self.config, self.survey, self.filling, self.film)

    @cached_property
    def _result(self) -> dict[str, Any]:
        path = self.folder / RESULT
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError("there is no finished run", where=str(path), cure="name the folder of one") from error
        except ValueError as error:
            raise InputError(f"the result is damaged: {error}", where=str(path), cure="run again") from error
        if not {"store", "config"} <= set(content.get("outputs", ())):
            raise InputError(
                "the run folder was written by an older version",
                where=str(path),
                cure=f"slideframe run {self.folder / CONFIG} writes it anew from what the store holds",
            )
        return content

    def _product(self, kind: StageKind) -> Any:
        """Return the stage's product.

        Raises:
            InputError: the run stopped before that stage, or the store has lost its result.
        """
        key = self._result.get("keys", {}).get(kind)
        if not key:
            raise InputError(
                f"the run has no result of its {kind}",
                where=str(self.folder),
                cure=f"carry it on with slideframe run {self.folder / CONFIG}",
            )
        entry = Store(Path(self._result["outputs"]["store"])).entry(kind, key)
        if not entry.is_whole:
            raise InputError(
                f"the store no longer holds the run's result of its {kind}",
                where=str(entry.folder),
                cure=f"compute it again with slideframe run {self.folder / CONFIG}",
            )
        return entry.read(PRODUCT_OF[kind])
