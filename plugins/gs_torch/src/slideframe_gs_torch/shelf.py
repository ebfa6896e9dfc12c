"""Photographs at hand for training: in memory as far as they fit, beyond on disk, undistorted and reduced."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, overload

import numpy as np
import torch

from slideframe.arrays import Float32Array, UInt8Array
from slideframe.errors import StageFailed
from slideframe_gs_torch.allocator import return_freed_memory
from slideframe_gs_torch.views import TrainingView

# What the fourth plane of a picture says of its pixels, beside 0, left out.
USED, SKY = 1, 2
# The widths that training shows them at, as divisors of the full one.
FACTORS = (1, 2, 4)


class Shelf:
    """Holds arrays in memory up to a number of bytes, and those that come later in files of a folder.

    Attributes:
        held: bytes in memory.
    """

    def __init__(self, folder: Path, most: int) -> None:
        """Take the folder, which is made when it is needed, and the most bytes to hold in memory."""
        self._folder, self._most = folder, most
        self.held = 0

    def put(self, name: str, array: UInt8Array) -> Callable[[], UInt8Array]:
        """Keep an array and return what fetches it.

        Raises:
            StageFailed: the disk has no room for it.
        """
        if self.held + array.nbytes <= self._most:
            self.held += array.nbytes
            return lambda: array
        path = self._folder / f"{name}.npy"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            np.save(path, array, allow_pickle=False)
        except OSError as error:
            raise StageFailed(
                f"photographs beyond `photographs_megabytes` can't be kept on disk: {error.strerror or error}",
                where=str(path),
                cure="free some space, raise photographs_megabytes, or lower image_width",
            ) from error
        return partial(np.load, path, allow_pickle=False)


class _Shelved(NamedTuple):
    """A view whose pixels, mask and sky are elsewhere, as a picture of three or four planes."""

    empty: TrainingView
    fetch: Callable[[], UInt8Array]

    def view(self) -> TrainingView:
        planes = torch.from_numpy(self.fetch())
        if len(planes) == 3:
            return replace(self.empty, pixels=planes)
        sky = planes[3] == SKY
        return replace(self.empty, pixels=planes[:3], mask=planes[3] == USED, sky=sky if sky.any() else None)


class ShelvedViews(Sequence[TrainingView]):
    """Views of which a few are in memory at a time; each by its place, in full or reduced."""

    def __init__(self, views: Iterable[TrainingView], shelf: Shelf) -> None:
        """Put all widths of the views, which may be read one by one, on the shelf."""
        self._views = []
        for view in views:
            self._views.append({factor: _shelved(view, factor, shelf) for factor in FACTORS})
            return_freed_memory()

    def __len__(self) -> int:
        return len(self._views)

    @overload
    def __getitem__(self, place: int) -> TrainingView: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[TrainingView]: ...
    def __getitem__(self, place: int | slice) -> TrainingView | Sequence[TrainingView]:
        if isinstance(place, slice):
            raise TypeError("views are fetched one by one")
        return self.reduced(place, 1)

    def __iter__(self) -> Iterator[TrainingView]:
        return (self[place] for place in range(len(self)))

    def reduced(self, place: int, factor: int) -> TrainingView:
        """Return a view, reduced by one of FACTORS."""
        return self._views[place][factor].view()

    def add_depths(self, points: Float32Array) -> None:
        """Let every view know the depths of the sparse points (point, 3) that it sees."""
        self._views = [
            {factor: shelved._replace(empty=shelved.empty.with_depths(points)) for factor, shelved in widths.items()}
            for widths in self._views
        ]


def _shelved(view: TrainingView, factor: int, shelf: Shelf) -> _Shelved:
    reduced = view.reduced(factor)
    planes = reduced.pixels
    if reduced.mask is not None:
        use = reduced.mask.to(torch.uint8) * USED
        if reduced.sky is not None:
            use[reduced.sky] = SKY
        planes = torch.cat([planes, use[None]])
    fetch = shelf.put(f"{view.index:06d}-{factor}", planes.numpy())
    return _Shelved(replace(reduced, pixels=reduced.pixels[:, :0, :0].clone(), mask=None, sky=None), fetch)
