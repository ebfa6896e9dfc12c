"""What colour unseen soil has."""

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array, Int32Array
from slideframe.products import SplatCloud

HARMONIC_0 = 0.28209479177387814  # zeroth real spherical harmonic, 1 / (2 sqrt(pi))
PATCH_SPACINGS = 2.0  # side of the patches of one colour of a palette, in particle spacings
# Grass and shadows end at the surface: its colours fade with depth into those of bare ground.
FADING_DEPTH = 1.0  # m at which 1 / e of the surface's own colour is left
# Lumps of soil: side, in spacings of the splats, which blend with their neighbours, and share in the colours' variety.
LUMPS = ((2.0, 0.5), (6.0, 0.4))
# Of bare ground, what is neither in shadow nor painted.
USUAL_BRIGHTNESS = (10.0, 90.0)  # percentiles
QUERIES_AT_ONCE = 200_000

UInt64Array = npt.NDArray[np.uint64]
Color = tuple[float, float, float]


class SoilColors:
    """Base colours of soil: the surface's nearby, or a palette's."""

    def __init__(
        self,
        observed: SplatCloud,
        ground: Float32Array,
        photographed: Float32Array,
        neighbors: int,
        palette: tuple[Color, ...],
    ) -> None:
        """Look colours up for the vertices of the ground's surface.

        Args:
            observed: splats of the surface.
            ground: vertices of the surface (vertex, 3), m.
            photographed: sRGB colours of the vertices (vertex, 3); NaN where the splats must tell.
            neighbors: splats whose mean colours such a vertex; with 1, each point takes its own nearest one's instead.
            palette: sRGB colours to choose from instead; empty: the surface's.
        """
        self._observed, self._palette, self._of_vertex = observed, palette, None
        if not palette and neighbors > 1:
            unseen = np.flatnonzero(np.isnan(photographed[:, 0]))
            self._of_vertex = _base(photographed)
            self._of_vertex[unseen] = _mean_colors(ground[unseen], observed, neighbors)
            self._bare = _bare(self._of_vertex)
            self._usual = np.median(self._bare, axis=0)

    def at(self, points: Float32Array, foot: Float32Array, vertex: Int32Array, spacing: float) -> Float32Array:
        """Return the base colour (point, 1, 3) of soil at `points` (point, 3).

        Args:
            points: where, m.
            foot: nearest point of the surface (point, 3), m.
            vertex: vertex of the surface nearest to that (point,).
            spacing: of the particles, m.
        """
        if self._palette:
            colors = _picked(_base(np.asarray(self._palette, np.float32)), points, PATCH_SPACINGS * spacing)
        elif self._of_vertex is None:
            colors = self._observed.harmonics[_nearest(foot, self._observed, 1)[:, 0], 0]
        else:
            depth = np.linalg.norm(foot - points, axis=1)[:, None]
            left = np.exp(-depth / FADING_DEPTH)
            colors = left * self._of_vertex[vertex] + (1 - left) * self._usual
            for side, share in LUMPS:
                colors += share * (_picked(self._bare, points, side * spacing) - self._usual)
        return np.ascontiguousarray(colors[:, None, :], np.float32)


def _base(colors: Float32Array) -> Float32Array:
    """Return the coefficients of the zeroth harmonic that show as these sRGB colours."""
    return np.asarray((colors - np.float32(0.5)) / np.float32(HARMONIC_0), np.float32)


def _bare(colors: Float32Array) -> Float32Array:
    """Return those of the base colours (point, 3) that are bare ground's: the half with the least excess green.

    Excess green 2 g - r - b tells plants from soil (Woebbecke et al. 1995).
    """
    greenness = 2 * colors[:, 1] - colors[:, 0] - colors[:, 2]
    bare = colors[greenness <= np.median(greenness)]
    brightness = bare.mean(axis=1)
    low, high = np.percentile(brightness, USUAL_BRIGHTNESS)
    usual: Float32Array = bare[(brightness >= low) & (brightness <= high)]
    return usual


def _picked(colors: Float32Array, points: Float32Array, size: float) -> Float32Array:
    """Return one of the colours for each point, the same for all in a cube of `size` metres."""
    return colors[(_hash(points, size) % np.uint64(len(colors))).astype(np.int64)]


def _mean_colors(points: Float32Array, observed: SplatCloud, neighbors: int) -> Float32Array:
    """Return the mean base colour (point, 3) of the nearest splats, weighed by opacity and size, none beyond 0 to 1.

    One splat alone is a poor witness: splats overlap, and colours far outside 0 to 1 are common among small ones.
    """
    base = observed.harmonics[:, 0].clip(-0.5 / HARMONIC_0, 0.5 / HARMONIC_0)
    areas = np.sort(observed.scales, axis=1)[:, 1:].prod(axis=1)
    colors = np.empty((len(points), 3), np.float32)
    for first in range(0, len(points), QUERIES_AT_ONCE):
        part = slice(first, first + QUERIES_AT_ONCE)
        nearest = _nearest(points[part], observed, neighbors)
        weights = (observed.opacities * areas)[nearest][:, :, None]
        colors[part] = (base[nearest] * weights).sum(axis=1) / weights.sum(axis=1)
    return colors


def _nearest(points: Float32Array, observed: SplatCloud, neighbors: int) -> npt.NDArray[np.int64]:
    """Return the nearest splats (point, neighbour) of each point."""
    from scipy.spatial import cKDTree

    count = min(neighbors, len(observed))
    found = cKDTree(observed.centers).query(points, k=count, workers=-1)[1]
    return np.asarray(found, np.int64).reshape(-1, count)


def _hash(points: Float32Array, size: float) -> UInt64Array:
    """Return a number that is as good as random for each patch of `size` metres (point,)."""
    patch = np.floor(points.astype(np.float64) / size).astype(np.int64).view(np.uint64)
    # multiplicative hashing (Teschner et al. 2003, "Optimized spatial hashing"), then the murmur3 finaliser
    mixed = patch[:, 0] * np.uint64(73856093) ^ patch[:, 1] * np.uint64(19349663) ^ patch[:, 2] * np.uint64(83492791)
    mixed = (mixed ^ (mixed >> np.uint64(33))) * np.uint64(0xFF51AFD7ED558CCD)
    shuffled: UInt64Array = mixed >> np.uint64(40)
    return shuffled
