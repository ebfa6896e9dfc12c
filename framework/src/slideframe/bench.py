"""Where stages compute: each result is looked up by key, or computed, stored and shown."""

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, cast

from pydantic import BaseModel

from slideframe import __version__, compact
from slideframe.arrays import Product
from slideframe.catalogue import Listing
from slideframe.crew import device_for
from slideframe.device import Device
from slideframe.errors import PluginError, SlideframeError, StageFailed
from slideframe.meter import Meter
from slideframe.problem import ProblemModel, SimulationProblem, Site
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey
from slideframe.stages import Context, PoseSource, Stage, StageKind
from slideframe.store import Entry, Store, digest, digest_file

PRODUCT_OF: dict[StageKind, type[Product]] = {
    "pose_source": Survey,
    "reconstructor": SplatCloud,
    "volume_filler": Filling,
    "solver": ParticleFrame,
    "renderer": Picture,
}
# how far stored positions may be from the solver's, where frames are stored in 16 bits
ERROR = "stored_position_error_m"
STREAMS: frozenset[StageKind] = frozenset({"solver", "renderer"})

Value = TypeVar("Value")
_log = logging.getLogger("slideframe")


@dataclass(frozen=True)
class Keyed(Generic[Value]):
    """A result that is in the store, or will be, under its key; read when first looked at."""

    kind: StageKind
    key: str
    entry: Entry

    @cached_property
    def value(self) -> Value:
        """The product, or the stream of products."""
        return cast(Value, self.entry.read(PRODUCT_OF[self.kind]))


class ReachedGoal(Exception):
    """The last stage that was asked for has its result."""


class Watcher(Protocol):
    """Sees stages come and go."""

    def started(self, stage: Stage) -> None:
        """Tell that a stage begins to compute."""

    def progress(self, stage: Stage, done: float, total: float, figures: Mapping[str, float]) -> None:
        """Tell how far it is."""

    def finished(self, stage: Stage, result: Keyed[Any], cached: bool) -> None:
        """Tell that a stage's result is in the store."""


@dataclass
class Bench:
    """Runs stages for one run.

    Attributes:
        dry: only find out which results are there, compute nothing.
        until: the last kind of stage to carry out; none: all.
        results: what each kind of stage came to, in order.
        computed: kinds whose result was not in the store.
    """

    store: Store
    listings: Mapping[str, Listing]
    device: Device
    seed: int
    watcher: Watcher
    dry: bool = False
    until: StageKind | None = None
    results: dict[StageKind, Keyed[Any]] = field(default_factory=dict)
    computed: set[StageKind] = field(default_factory=set)

    def step(self, work: Callable[..., Value], *inputs: Keyed[Any] | ProblemModel) -> Keyed[Value]:
        """Carry out one stage's method, unless its result is known.

        Raises:
            SlideframeError: as the stage raised it.
            StageFailed: the stage raised anything else.
            PluginError: the stage returned something that is not its product.
            ReachedGoal: this was the last stage asked for.
        """
        stage: Stage = work.__self__  # type: ignore[attr-defined]
        ingredients = self._ingredients(stage, inputs)
        key = digest(ingredients) if ingredients else ""
        result: Keyed[Value] = Keyed(stage.kind, key, self.store.entry(stage.kind, key))
        cached = bool(key) and result.entry.is_whole
        if not cached:
            self.computed.add(stage.kind)
            if not self.dry:
                with result.entry.held():
                    if not result.entry.is_whole:
                        self._compute(stage, work, inputs, ingredients, result.entry)
        self.results[stage.kind] = result
        if not self.dry:
            self.watcher.finished(stage, result, cached)
        if stage.kind == self.until:
            raise ReachedGoal
        return result

    def check(self, rule: Callable[..., None], *inputs: Keyed[Any] | ProblemModel) -> None:
        """Apply a rule that joins products and problem, before later stages spend their time."""
        if not self.dry:
            rule(*map(_unwrap, inputs))

    def _ingredients(self, stage: Stage, inputs: tuple[Keyed[Any] | ProblemModel, ...]) -> dict[str, Any] | None:
        """Return all that decides the result, or None while an input is still to be computed."""
        if any(isinstance(item, Keyed) and not item.entry.is_whole for item in inputs):
            return None
        listing = self.listings[stage.name]
        files = [path for item in (stage, *inputs) if isinstance(item, BaseModel) for path in _named_files(item)]
        if isinstance(stage, PoseSource):
            site = next(item for item in inputs if isinstance(item, Site))
            files.extend(stage.input_files(site))
        return {
            "plugin": [listing.distribution, listing.name, listing.version],
            "framework": __version__,
            "options": stage.model_dump(mode="json"),
            "inputs": [
                item.entry.content if isinstance(item, Keyed) else item.model_dump(mode="json") for item in inputs
            ],
            "files": [[str(path), digest_file(path)] for path in files],
            "seed": self.seed,
        }

    def _compute(
        self,
        stage: Stage,
        work: Callable[..., Any],
        inputs: tuple[Keyed[Any] | ProblemModel, ...],
        ingredients: dict[str, Any] | None,
        entry: Entry,
    ) -> None:
        device = device_for(stage, self.device)
        context = Context(
            device=device,
            scratch=entry.scratch,
            pictures=entry.pictures_of_stage,
            cache=self.store.cache(stage.name),
            seed=self.seed,
            stored=entry.stored_items(PRODUCT_OF[stage.kind]) if stage.kind in STREAMS else 0,
            on_progress=lambda done, total, figures: self.watcher.progress(stage, done, total, figures),
        )
        self.watcher.started(stage)
        _log.info("%s starts on %s", self.listings[stage.name], device)
        meter = Meter()

        def finish() -> dict[str, Any]:
            # the figures of time are of this run alone
            resumed = {"resumed_from_item": context.first_item} if context.first_item else {}
            return {
                "figures": context.figures | meter.figures() | {"device": str(device)} | resumed,
                "warnings": context.warnings,
                "made_from": ingredients,
            }

        try:
            product = work(*map(_unwrap, inputs), context)
            if stage.kind in STREAMS:
                items = self._checked_items(stage, product, inputs, context)
                entry.write_stream(items, finish, lambda: context.first_item, compactly=_compactly(inputs))
            else:
                entry.write(self._checked(stage, product), finish)
        except SlideframeError:
            raise
        except Exception as error:  # foreign code: whatever it raises is reported with its name
            raise StageFailed(
                f"{self.listings[stage.name]} stopped: {type(error).__name__}: {error}",
                where=f"stage {stage.kind}",
                cure="the log file holds the traceback; results of earlier stages are kept",
            ) from error

    def _checked_items(
        self, stage: Stage, items: Any, inputs: tuple[Keyed[Any] | ProblemModel, ...], context: Context
    ) -> Iterator[Product]:
        if not isinstance(items, Iterator):
            raise self._wrong(stage, items)
        given, worst = 0, 0.0
        for item in items:
            if not given and context.first_item:
                _log.info("%s goes on from item %d", self.listings[stage.name], context.first_item)
            given += 1
            product = self._checked(stage, item)
            if isinstance(product, ParticleFrame) and _compactly(inputs):
                # of the frames of this run; the mass spreads, so the last ones have the largest
                worst = max(worst, compact.largest_error(product.positions))
                context.figure(ERROR, worst)
            yield product
        count = context.first_item + given
        least, most = _expected_items(inputs)
        if not least <= count <= most:
            raise PluginError(
                f"{self.listings[stage.name]} gave {count} items of {most}",
                where=f"stage {stage.kind}",
                cure="a solver yields one frame for each output time, a renderer one picture for each frame",
            )

    def _checked(self, stage: Stage, product: object) -> Product:
        if not isinstance(product, PRODUCT_OF[stage.kind]):
            raise self._wrong(stage, product)
        return product

    def _wrong(self, stage: Stage, product: object) -> PluginError:
        return PluginError(
            f"{self.listings[stage.name]} gave {type(product).__name__}, not {PRODUCT_OF[stage.kind].__name__}",
            where=f"stage {stage.kind}",
            cure="see docs/writing_a_plugin.md",
        )


def _named_files(value: object) -> Iterator[Path]:
    """Give every file that options or a problem name, those of a named folder included.

    A site's photographs are left to its pose source, which knows which of them it reads.
    """
    if isinstance(value, BaseModel) and not isinstance(value, Site):
        for name in type(value).model_fields:
            yield from _named_files(getattr(value, name))
    elif isinstance(value, Mapping):
        yield from _named_files(tuple(value.values()))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _named_files(item)
    elif isinstance(value, Path):
        yield from sorted(path for path in value.rglob("*") if path.is_file()) if value.is_dir() else [value]


def _compactly(inputs: tuple[Keyed[Any] | ProblemModel, ...]) -> bool:
    """Whether the problem asks for frames in 16 bits."""
    return any(isinstance(item, SimulationProblem) and item.simulation.stored_frames == "compact" for item in inputs)


def _expected_items(inputs: tuple[Keyed[Any] | ProblemModel, ...]) -> tuple[int, int]:
    """Return the least and the most frames that the problem asks for, or how many the motion holds."""
    for item in inputs:
        if isinstance(item, SimulationProblem):
            most = item.simulation.frame_count
            return (2 if item.simulation.stop == "rest" else most), most
        if isinstance(item, Keyed) and item.kind == "solver":
            return len(item.value), len(item.value)
    raise AssertionError("a stream is made from a simulation or a motion")


def _unwrap(item: Any) -> Any:
    return item.value if isinstance(item, Keyed) else item
