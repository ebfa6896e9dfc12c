"""The film as people see it: its pictures in order, with the overlay where the config asks for it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.config import RunConfig
from slideframe.formats.posed_camera import PosedCamera
from slideframe.overlay import Overlay
from slideframe.problem import Shot
from slideframe.products import Camera, Filling, Picture, Survey
from slideframe.stills import contact_sheet, side_by_side
from slideframe.store import storing

FILM, SHEET, COMPARISON = "film.mp4", "contact_sheet.png", "before_after.png"


@dataclass(frozen=True)
class Showing:
    """A run's film with all that decides how it looks."""

    config: RunConfig
    survey: Survey
    filling: Filling
    film: Sequence[Picture]

    @cached_property
    def bounds(self) -> Float64Array:
        """The lowest and the highest corner (2, 3) of the soil at t = 0, m."""
        return soil_bounds(self.filling)

    @cached_property
    def shot(self) -> Shot:
        """The way of the camera."""
        return self.config.view.shot(self.survey, self.bounds)

    @cached_property
    def overlay(self) -> Overlay:
        """What is written on the pictures."""
        return Overlay(tuple(legend(self.config)), self.bounds.mean(axis=0))

    def camera(self, index: int) -> tuple[Camera, Float64Array]:
        """Return the camera of a picture and its world_from_camera (3, 4)."""
        return self.shot(index / max(len(self.film) - 1, 1))

    def posed_cameras(self) -> list[PosedCamera]:
        """Return the camera of every picture, named as its PNG."""
        return [PosedCamera(frame_name(index), *self.camera(index)) for index in range(len(self.film))]

    def picture(self, index: int) -> tuple[UInt8Array, float]:
        """Return a picture's pixels, with the overlay where it is asked for, and its time, s."""
        picture = self.film[index]
        if not self.config.outputs.overlay:
            return picture.pixels, picture.time
        return self.overlay.on(picture.pixels, picture.time, *self.camera(index)), picture.time

    def write(self, folder: Path, progress: Callable[[str, float, float], None]) -> None:
        """Write the film, the contact sheet, and the first picture beside the last.

        Raises:
            StoreError: one can't be written.
        """
        from slideframe.formats.video import write_mp4

        def frames() -> Iterator[UInt8Array]:
            for index in range(len(self.film)):
                yield self.picture(index)[0]
                progress("film", index + 1, len(self.film))

        write_mp4(frames(), folder / FILM, self.config.simulation.frame_rate)
        self.write_stills(folder)

    def write_stills(self, folder: Path) -> None:
        """Write the contact sheet, and the first picture beside the last."""
        shown, count = self.config.outputs.contact_sheet, len(self.film)
        if shown and count:
            _save(contact_sheet(self.picture, count, shown), folder / SHEET)
        if count > 1:
            ends = [(pixels, f"{time:.2f} s") for pixels, time in (self.picture(0), self.picture(count - 1))]
            _save(side_by_side(ends), folder / COMPARISON)


def frame_name(index: int) -> str:
    """Return the file name of a film's picture."""
    return f"{index:06d}.png"


def soil_bounds(filling: Filling) -> Float64Array:
    """Return the lowest and the highest corner (2, 3) of the soil at t = 0, m: what an orbit looks at."""
    positions = filling.particle_positions
    return np.stack([positions.min(axis=0), positions.max(axis=0)]).astype(np.float64)


def legend(config: RunConfig) -> list[str]:
    """Return what a viewer of the film must know: the material, and who moved it."""
    material = config.material
    parts: list[str] = [material.kind]
    if angle := getattr(material, "friction_angle", None):
        parts.append(f"friction angle {angle:g} deg")
    parts.append(f"{material.density:g} kg/m3")
    return [", ".join(parts), f"simulated with {config.stages.solver}"]


def _save(picture: Image.Image, path: Path) -> None:
    with storing(path):
        partial = path.with_name(path.name + ".partial")
        picture.save(partial, "PNG")
        partial.rename(path)
