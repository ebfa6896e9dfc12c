"""The five stage interfaces. A stage is a value: its fields are its options, its one method does the work."""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from slideframe.arrays import UInt8Array
from slideframe.device import Device
from slideframe.errors import ConfigurationError
from slideframe.problem import FillingProblem, ProblemModel, Simulation, SimulationProblem, Site, View
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey

StageKind = Literal["pose_source", "reconstructor", "volume_filler", "solver", "renderer"]
FigureValue = float | int | str | bool | dict[str, float]

# Position, velocity, deformation and stress of one particle in float32, without any solver's extras.
LEAST_BYTES_PER_PARTICLE = 100

_log = logging.getLogger("slideframe")


def _ignore_progress(done: float, total: float, figures: dict[str, float]) -> None:
    """Stand in where nobody watches."""


@dataclass(frozen=True)
class Context:
    """What surrounds a stage while it computes.

    Attributes:
        device: where to compute.
        scratch: a folder of the stage's own. It survives a killed run and is empty or as the same stage,
            with the same options and inputs, left it; it is removed once the product is whole.
        cache: a folder of the plugin's own that outlives results and is shared by runs; what lies there is named by
            all that decides it and written whole, and may be deleted at any time. None: nothing is kept.
        seed: seed of every random choice.
        stored: how many items of this stream a run that broke off has left in the store, from the first on.
        figures: measured results by name, units in the name, such as `held_out_psnr_db`.
        warnings: statements that the user must see beside the result.
        pictures: a folder for pictures of how the stage comes along, kept beside the result; None: nobody looks.
    """

    device: Device
    scratch: Path
    cache: Path | None = None
    seed: int = 0
    stored: int = 0
    on_progress: Callable[[float, float, dict[str, float]], None] = _ignore_progress
    figures: dict[str, FigureValue] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    pictures: Path | None = None
    _resumed: list[int] = field(default_factory=list, init=False, repr=False)

    def resume(self, item: int) -> None:
        """Let the stream go on from item `item`, so that the stored ones before it are kept.

        To be called before the first item is given. A stage that never calls it gives all items again.

        Raises:
            ValueError: fewer items are stored.
        """
        if not 0 <= item <= self.stored:
            raise ValueError(f"the stream can't go on from item {item}: {self.stored} are stored")
        self._resumed[:] = [item]

    @property
    def first_item(self) -> int:
        """The item that the stage gives first."""
        return self._resumed[0] if self._resumed else 0

    def progress(self, done: float, total: float, **figures: float) -> None:
        """Tell how far the stage is, with figures worth watching."""
        self.on_progress(done, total, figures)

    def show(self, name: str, iteration: int, pixels: UInt8Array) -> None:
        """Keep a picture (row, column, 3), sRGB, for the recording, which shows it on the timeline `iteration`.

        It may be shown again after a run broke off. A disk without room for it costs the picture, not the stage.

        Args:
            name: of the series, which names its files too.
            iteration: of the stage.
            pixels: as 8-bit sRGB.
        """
        if self.pictures is None:
            return
        from PIL import Image

        try:
            folder = self.pictures / name
            folder.mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(folder / f"{iteration:08d}.jpg", quality=85)
        except OSError as error:
            _log.warning("a picture of %s at iteration %d could not be kept: %s", name, iteration, error)

    def figure(self, name: str, value: FigureValue) -> None:
        """Report a measured result, a finite number or a word."""
        value = getattr(value, "item", lambda: value)()  # NumPy's and torch's scalars
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"figure '{name}' is {value}")
        self.figures[name] = value

    def warn(self, message: str) -> None:
        """State something that the user must know beside the result."""
        self.warnings.append(message)
        _log.warning(message)


class Stage(BaseModel, ABC):
    """Base of the five interfaces.

    Attributes:
        kind: which interface the stage implements.
        name: the entry point's name, unique among installed distributions.
        backend: import names that must be there for the stage to compute.
        devices: kinds of device that the stage can use.
        presets: what the modes of a run set of its options, by mode, where the config doesn't.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: ClassVar[StageKind]
    name: ClassVar[str]
    backend: ClassVar[tuple[str, ...]] = ()
    devices: ClassVar[frozenset[str]] = frozenset({"cpu"})
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Raise a SlideframeError now for anything that would stop the stage later.

        `problem` is what the stage will be given: Site, FillingProblem, SimulationProblem or View
        (a Reconstructor is given the Site). The framework has checked `backend` before.
        """


class PoseSource(Stage):
    """Finds where each photograph was taken."""

    kind = "pose_source"

    @abstractmethod
    def locate(self, site: Site, context: Context) -> Survey:
        """Return the photographs with their cameras in the local frame."""

    @abstractmethod
    def input_files(self, site: Site) -> Sequence[Path]:
        """Return every file that the survey depends on; their bytes belong to the result's key."""


class Reconstructor(Stage):
    """Turns the survey into Gaussian splats."""

    kind = "reconstructor"

    @abstractmethod
    def reconstruct(self, survey: Survey, context: Context) -> SplatCloud:
        """Return the splats of the scene as photographed."""


class VolumeFiller(Stage):
    """Fills the ground below the splats with soil."""

    kind = "volume_filler"

    @abstractmethod
    def fill(self, survey: Survey, splats: SplatCloud, problem: FillingProblem, context: Context) -> Filling:
        """Return the soil volume of the region and the splats that move with it."""


class Solver(Stage):
    """Moves the filled volume.

    Attributes:
        features: what of slideframe.problem.FEATURES it can do; a problem that needs more is refused before anything
            is computed.
    """

    kind = "solver"
    features: ClassVar[frozenset[str]] = frozenset({"drucker_prager"})

    def require_features(self, problem: SimulationProblem) -> None:
        """Refuse a problem that this solver would solve in part only.

        Raises:
            ConfigurationError: with what is missing.
        """
        missing = ", ".join(sorted(problem.features - self.features))
        if missing:
            raise ConfigurationError(
                f"the solver '{self.name}' doesn't know: {missing}",
                where="stages.solver",
                cure="take another solver, such as mpm_warp, or change [material], [boundary] or [simulation]",
            )

    def least_memory(self, particle_count: float, simulation: Simulation) -> float:
        """Return the bytes that so many particles take at least; what is surely too much is refused before the start.

        Here position, velocity, deformation and stress of each in float32.
        """
        return particle_count * LEAST_BYTES_PER_PARTICLE

    @abstractmethod
    def solve(self, filling: Filling, problem: SimulationProblem, context: Context) -> Iterator[ParticleFrame]:
        """Yield one frame per output time, the first at t = 0. Frames own their arrays."""


class Renderer(Stage):
    """Draws the motion."""

    kind = "renderer"

    @abstractmethod
    def render(
        self,
        survey: Survey,
        splats: SplatCloud,
        filling: Filling,
        motion: Iterable[ParticleFrame],
        view: View,
        context: Context,
    ) -> Iterator[Picture]:
        """Yield one picture per frame of the motion, in order, reading each frame once."""
