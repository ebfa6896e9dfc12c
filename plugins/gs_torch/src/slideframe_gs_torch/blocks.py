"""A large site in parts, each trained on the photographs that see it, so that memory doesn't grow with the site.

The plan is cut in two across its longer side, at the median of the sparse points, until there are enough blocks. A
block trains on every photograph that sees enough of it, with what these show beyond it, and keeps the splats whose
centres lie within: where blocks meet both have seen the same ground by the same photographs (as Lin et al. 2024,
"VastGaussian").
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.products import SplatCloud, Survey
from slideframe_gs_torch.dense_start import pixels_of

# A photograph is a block's if that share of the sparse points that it sees lie there.
LEAST_SHARE = 0.05
NAMES = ("centers", "rotations", "scales", "opacities", "harmonics")


@dataclass(frozen=True)
class Block:
    """A rectangle of the plan, x and y from `low` to below `high`, m, without end at the rim; and its photographs."""

    low: Float64Array
    high: Float64Array
    photographs: tuple[int, ...]

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole plan."""
        return bool(np.isneginf(self.low).all() and np.isposinf(self.high).all())

    def contains(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
        """Tell which points (point, 3) lie in it."""
        plan = points[:, :2].astype(np.float64)
        return np.asarray(((plan >= self.low) & (plan < self.high)).all(axis=1))

    def keep(self, splats: SplatCloud) -> SplatCloud:
        """Return the splats that lie in it."""
        inside = self.contains(splats.centers)
        return SplatCloud(**{name: getattr(splats, name)[inside] for name in NAMES})


def blocks_of(survey: Survey, count: int) -> list[Block]:
    """Cut the site into `count` blocks of equally many sparse points; one that no photograph sees is left out."""
    points = survey.sparse_points.astype(np.float64)
    infinite = np.full(2, np.inf)
    everything = Block(-infinite, infinite, tuple(range(len(survey.photographs))))
    if count == 1 or len(points) < 2 * count:
        return [everything]
    corners = _cut(points[:, :2], -infinite, infinite, count)
    inside = np.array([Block(low, high, ()).contains(points) for low, high in corners])
    shares = np.array([_shares(survey, index, points, inside) for index in everything.photographs])
    blocks = [
        Block(low, high, tuple(int(index) for index in np.flatnonzero(share >= LEAST_SHARE)))
        for (low, high), share in zip(corners, shares.T, strict=True)
    ]
    return [block for block in blocks if block.photographs]


def survey_of(survey: Survey, block: Block) -> Survey:
    """Return the survey with those sparse points alone that the block's photographs see."""
    points = survey.sparse_points.astype(np.float64)
    seen = np.zeros(len(points), bool)
    for index in block.photographs:
        seen |= _sees(survey, index, points)
    names = ("sparse_points", "sparse_colors", "sparse_errors")
    return survey.model_copy(update={name: getattr(survey, name)[seen] for name in names})


def _cut(
    plan: Float64Array, low: Float64Array, high: Float64Array, count: int
) -> list[tuple[Float64Array, Float64Array]]:
    """Return the corners of `count` rectangles, cut across the longer side of the points (point, 2) in them."""
    if count == 1:
        return [(low, high)]
    axis = int(np.argmax(np.ptp(plan, axis=0)))
    first = count // 2
    edge = float(np.quantile(plan[:, axis], first / count))
    below, above = high.copy(), low.copy()
    below[axis] = above[axis] = edge
    left = plan[:, axis] < edge
    return [*_cut(plan[left], low, below, first), *_cut(plan[~left], above, high, count - first)]


def _shares(survey: Survey, index: int, points: Float64Array, inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Return which shares of the points that a photograph sees lie in each block, `inside` (block, point)."""
    seen = _sees(survey, index, points)
    return np.asarray(inside[:, seen].sum(axis=1) / max(seen.sum(), 1))


def _sees(survey: Survey, index: int, points: Float64Array) -> npt.NDArray[np.bool_]:
    """Tell which points lie in a photograph's frame, whatever may hide them."""
    camera = survey.camera_of(index)
    pixels, before = pixels_of(points, camera, survey.world_from_camera[index])
    return np.asarray(before & (pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1))


def merge(parts: list[SplatCloud]) -> SplatCloud:
    """Return the splats of all parts."""
    return SplatCloud(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in NAMES})
