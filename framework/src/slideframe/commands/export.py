"""`slideframe export RUN --what KIND`: a run's splats, cameras and pictures for other programs."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slideframe.errors import ConfigurationError

What = Literal["splats", "sequence", "particles", "cameras", "frames", "maps", "film"]


@dataclass(frozen=True)
class ExportOptions:
    """Write a finished run's splats, cameras or pictures as files of other programs."""

    run: Annotated[Path, tyro.conf.Positional]
    """A run folder."""
    what: What = "splats"
    """splats: of one frame; sequence: of many; particles: points with their velocity and, where recorded, stress;
    cameras: of survey and film; frames, maps: of the film; film: anew."""
    out: Path | None = None
    """Folder to write into; by default `export` in the run folder."""
    frame: int = -1
    """Of `splats`: number of the frame from 0, or from the end if negative."""
    every: int = 1
    """Of `sequence`, `particles`, `frames` and `maps`: only each n-th frame, from the first on."""
    suffix: Literal[".ply", ".compressed.ply", ".spz"] = ".ply"
    """Form of the splats; the last two need the extra `compressed`."""
    codec: Literal["h264", "av1"] = "h264"
    """Of `film`."""
    overlay: bool = False
    """Time, scale bar and legend on `frames` and `film`, whatever the run's config says."""
    epsg: int | None = None
    """Projected coordinate system in which georeference.json gives the origin too."""


def main(arguments: Sequence[str]) -> int:
    """Write the files and say where they are."""
    options = tyro.cli(ExportOptions, args=list(arguments), prog="slideframe export")
    if options.every < 1:
        raise ConfigurationError("every n-th frame must be the first or later", where="--every", cure="give 1 or more")
    paths = _export(options)
    print(f"{len(paths)} files and folders in {paths[0].parent if len(paths) > 1 else paths[0]}")
    return 0


def _export(options: ExportOptions) -> list[Path]:
    from slideframe.exporting import Exporter
    from slideframe.stored_run import StoredRun

    run = StoredRun(options.run, overlay=options.overlay)
    exporter = Exporter(run, options.out or options.run / "export", options.epsg)
    match options.what:
        case "splats":
            return exporter.splats([_place(options.frame, len(run.motion))], options.suffix, _tell)
        case "sequence":
            return exporter.splats(range(0, len(run.motion), options.every), options.suffix, _tell)
        case "particles":
            return exporter.particles(range(0, len(run.motion), options.every), _tell)
        case "cameras":
            return exporter.cameras()
        case "frames":
            return exporter.frames(range(0, len(run.film), options.every), _tell)
        case "maps":
            return exporter.maps(range(0, len(run.film), options.every), _tell)
        case "film":
            return exporter.film(options.codec, _tell)


def _place(frame: int, count: int) -> int:
    """Return the frame's number from 0.

    Raises:
        ConfigurationError: there is no such frame.
    """
    if not -count <= frame < count:
        raise ConfigurationError(
            f"there is no frame {frame}", where="--frame", cure=f"the motion has {count}: give 0 to {count - 1}"
        )
    return frame % count


def _tell(done: int, total: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)
