"""The background grid of explicit solvers."""

import math

from slideframe.arrays import Float64Array
from slideframe.problem.base import ProblemModel, Vector


class Grid(ProblemModel):
    """A uniform background grid. Node (i, j, k) stands at origin + spacing (i, j, k).

    The low walls lie on the nodes with index `padding`; the high walls on the first nodes at or beyond
    the eastern and northern bounds, `high` in index; there is no wall above.
    """

    origin: Vector
    spacing: float
    shape: tuple[int, int, int]
    high: tuple[int, int]

    padding: int = 3

    @property
    def extent(self) -> Vector:
        """From wall to wall, and from the floor to the top of the grid, m."""
        across = [self.spacing * (high - self.padding) for high in self.high]
        return across[0], across[1], self.spacing * (self.shape[2] - 1 - self.padding)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)


def place_grid(bounds: Float64Array, spacing: float) -> Grid:
    """Cover a volume from its base to a quarter of its height above its top, with padding all around.

    Args:
        bounds: lowest and highest corner (2, 3), m.
        spacing: m.
    """
    pad = Grid.model_fields["padding"].default
    low, high = bounds
    headroom = max(4 * spacing, 0.25 * (high[2] - low[2]))
    # 1e-6 of a cell forgives the rounding of decimal input such as 40.0 / 0.1
    extents = high - low
    extents[2] += headroom
    cells = [math.ceil(extent / spacing - 1e-6) for extent in extents]
    return Grid(
        origin=tuple((low - pad * spacing).tolist()),
        spacing=spacing,
        shape=(cells[0] + 2 * pad + 1, cells[1] + 2 * pad + 1, cells[2] + 2 * pad + 1),
        high=(cells[0] + pad, cells[1] + pad),
    )
