"""A run's splats, cameras and pictures as files of other programs, each whole or absent."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.coupling import Coupling, MovedSplats
from slideframe.errors import InputError
from slideframe.formats.colmap import write_colmap_views
from slideframe.formats.georeference import write_georeference
from slideframe.formats.particle_ply import write_particle_ply
from slideframe.formats.posed_camera import PosedCamera, posed_cameras
from slideframe.formats.splat_file import write_splats
from slideframe.formats.transforms_json import write_transforms_json
from slideframe.formats.video import Codec, write_mp4
from slideframe.harmonics import rotate_harmonics
from slideframe.products import SplatCloud
from slideframe.showing import frame_name
from slideframe.store import storing
from slideframe.stored_run import StoredRun

GEOREFERENCE, SEQUENCE, PARTICLES = "georeference.json", "sequence.json", "particles.json"
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Exporter:
    """Writes of a run into a folder; `epsg` is a projected system for the georeference too."""

    run: StoredRun
    folder: Path
    epsg: int | None = None

    def splats(self, frames: Sequence[int], suffix: str, progress: Progress) -> list[Path]:
        """Write all splats at those frames, each into a numbered file, and their times and georeference."""
        coupling, motion = Coupling(self.run.splats, self.run.filling), self.run.motion
        paths, times = [], {}
        for done, index in enumerate(frames):
            frame = motion[index]
            path = self.folder / f"splats-{index:06d}{suffix}"
            with self._whole(path) as partial:
                write_splats(turned_cloud(coupling.at(frame)), partial)
            paths.append(path)
            times[path.name] = frame.time
            progress(done + 1, len(frames))
        return [*paths, self._times(SEQUENCE, times), self._georeference()]

    def particles(self, frames: Sequence[int], progress: Progress) -> list[Path]:
        """Write the particles at those frames, each into a numbered file with all that they carry, and their times."""
        paths, times = [], {}
        for done, index in enumerate(frames):
            frame, path = self.run.motion[index], self.folder / f"particles-{index:06d}.ply"
            with self._whole(path) as partial:
                write_particle_ply(frame, partial)
            paths.append(path)
            times[path.name] = frame.time
            progress(done + 1, len(frames))
        return [*paths, self._times(PARTICLES, times), self._georeference()]

    def cameras(self) -> list[Path]:
        """Write the survey's cameras, and the film's where there is one, as COLMAP models and transforms.json."""
        written = self._views(posed_cameras(self.run.survey), "survey_cameras")
        if self.run.has("renderer"):
            written += self._views(self.run.showing.posed_cameras(), "film_cameras")
        return [*written, self._georeference()]

    def frames(self, frames: Sequence[int], progress: Progress) -> list[Path]:
        """Write pictures of the film as PNG, with the overlay where the config asks for it."""
        showing, paths = self.run.showing, []
        for done, index in enumerate(frames):
            paths.append(self._image(Image.fromarray(showing.picture(index)[0]), "frames", frame_name(index)))
            progress(done + 1, len(frames))
        return paths

    def maps(self, frames: Sequence[int], progress: Progress) -> list[Path]:
        """Write the maps that the film keeps: depth (m) and alpha as 32-bit TIFF, normals (n + 1) / 2 as PNG.

        Raises:
            InputError: the film keeps none.
        """
        film, paths, names = self.run.film, [], self.run.config.view.maps
        if not names:
            raise InputError(
                "the film keeps no maps", where="view.maps", cure='run with --set \'view.maps=["depth", "normal"]\''
            )
        for done, index in enumerate(frames):
            for name in names:
                values = getattr(film[index], name)
                if name == "normal":
                    levels = np.rint((values + 1) * 127.5).astype(np.uint8)
                    paths.append(self._image(Image.fromarray(levels), name, frame_name(index)))
                else:
                    tiff = Path(frame_name(index)).with_suffix(".tif").name
                    paths.append(self._image(Image.fromarray(values), name, tiff))
            progress(done + 1, len(frames))
        return paths

    def film(self, codec: Codec, progress: Progress) -> list[Path]:
        """Write the film anew."""
        showing, count = self.run.showing, len(self.run.film)

        def pictures() -> Iterator[np.ndarray]:
            for index in range(count):
                yield showing.picture(index)[0]
                progress(index + 1, count)

        path = self.folder / f"film-{codec}.mp4"
        with storing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        write_mp4(pictures(), path, self.run.config.simulation.frame_rate, codec)
        return [path]

    def _earlier_times(self, listing: Path) -> dict[str, float]:
        """Return the times, s, of the files that an earlier export left beside its listing."""
        with suppress(OSError, ValueError, KeyError):
            seconds = json.loads(listing.read_text(encoding="utf-8"))["seconds"]
            return {name: time for name, time in seconds.items() if (self.folder / name).is_file()}
        return {}

    def _views(self, views: Sequence[PosedCamera], name: str) -> list[Path]:
        folder = self.folder / name
        with storing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            write_colmap_views(views, folder)
            write_transforms_json(views, folder / "transforms.json")
        return [folder]

    def _times(self, name: str, times: dict[str, float]) -> Path:
        """Write the seconds of the files written now, beside those of earlier exports."""
        path = self.folder / name
        times = self._earlier_times(path) | times
        with self._whole(path) as partial:
            partial.write_text(json.dumps({"seconds": dict(sorted(times.items()))}, indent=1), encoding="utf-8")
        return path

    def _georeference(self) -> Path:
        path = self.folder / GEOREFERENCE
        with self._whole(path) as partial:
            write_georeference(self.run.survey.georeference, partial, self.epsg)
        return path

    def _image(self, image: Image.Image, folder: str, name: str) -> Path:
        path = self.folder / folder / name
        with self._whole(path) as partial:
            image.save(partial)
        return path

    @contextmanager
    def _whole(self, path: Path) -> Iterator[Path]:
        """Give the place of a file being written, which gets its name when it is whole and is gone if it never is."""
        partial = path.with_name("partial-" + path.name)
        try:
            with storing(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                yield partial
                partial.rename(path)
        finally:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


def turned_cloud(moved: MovedSplats) -> SplatCloud:
    """Return moved splats as a cloud of their own, whose harmonics have turned with the ground."""
    lengths = np.linalg.norm(moved.rotations, axis=1, keepdims=True)
    return SplatCloud(
        centers=moved.centers,
        rotations=moved.rotations / lengths,
        scales=moved.scales,
        opacities=moved.opacities,
        harmonics=rotate_harmonics(moved.harmonics, moved.frame_rotations.astype(np.float64)),
    )
