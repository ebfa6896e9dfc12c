"""Where the grid's nodes are and in what order particles lie, so that memory follows the particles, not the box."""

from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.problem import Simulation
from slideframe.tiles import COLOURS, HEADROOM, LARGEST_INDEX, TILE, require_room, runs, window


class Layout:
    """The nodes under the particles of one simulation; valid until a particle has moved by a cell.

    Attributes:
        corner: indices i, j of the first column.
        across: columns in a row.
        columns: (columns or more,), what to add to a layer's index k to find a column's node.
        owners: (nodes or more,), each node's column.
        nodes: (nodes or more,), momentum or velocity, and mass.
        forces: (nodes or more,), impulse of stress, or velocity before it, where a transfer keeps them; else `nodes`.
        order: (n,), the particles in the order of their first nodes.
        runs: (colours, most runs) runs of particles (first, count), of which those of a colour share no node, and how
            many of them each colour has.
    """

    def __init__(self, simulation: Simulation, particle_count: int, on_processor: bool) -> None:
        """Have no nodes yet."""
        import taichi as ti

        from slideframe_mpm_taichi.kernels import MOST_RUNS

        self._most_runs = MOST_RUNS
        self._on_processor, self._keeps_excess = on_processor, not simulation.transfer.constants.is_plain
        self._node = ti.types.vector(4, ti.f64 if simulation.precision == "float64" else ti.f32)
        self._bounds = ti.ndarray(ti.i32, 4)
        self._keys = ti.ndarray(ti.i32, particle_count)
        self._runs = ti.ndarray(ti.types.vector(2, ti.i32), (COLOURS, self._most_runs))
        self._arrays: dict[str, Any] = {}
        self.order = ti.ndarray(ti.i32, particle_count)
        self.runs: tuple[Any, list[int]] = (self._runs, [0] * COLOURS)

    def arrange(self, positions: Any) -> None:
        """Lay columns under the particles."""
        self._place_window(positions)
        self._place_tiles(positions)
        self._place_nodes()

    def _place_window(self, positions: Any) -> None:
        """Find the tiles that hold particles, and take one more on each side, and an even number of them."""
        from slideframe_mpm_taichi import kernels

        most = LARGEST_INDEX
        self._bounds.from_numpy(np.array([most, most, -most, -most], np.int32))
        kernels.bound_columns(positions, self._bounds)
        self.corner, self._tiles = window(*self._bounds.to_numpy().reshape(2, 2))
        self.across = self._tiles[1] * TILE

    def _place_tiles(self, positions: Any) -> None:
        """Give each tile as many nodes as the particles in it and around it need."""
        from slideframe_mpm_taichi import kernels

        count = self._tiles[0] * self._tiles[1]
        lowest, highest, bases, sizes, starts = (
            self._room(name, count + 1) for name in ("lowest", "highest", "bases", "sizes", "starts")
        )
        lowest.fill(LARGEST_INDEX)
        highest.fill(-LARGEST_INDEX)
        kernels.bound_tiles(positions, self.corner, self._tiles, lowest, highest)
        kernels.size_tiles(lowest, highest, self._tiles, bases, sizes)
        self._node_starts = np.concatenate([[0], np.cumsum(sizes.to_numpy()[:count])]).astype(np.int32)
        padded = np.zeros(starts.shape[0], np.int32)
        padded[: count + 1] = self._node_starts
        starts.from_numpy(padded)

    def _place_nodes(self) -> None:
        from slideframe_mpm_taichi import kernels

        self.node_count = int(self._node_starts[-1])
        self.columns = self._room("columns", self._tiles[0] * self._tiles[1] * TILE**2)
        self.owners = self._room("owners", self.node_count)
        self.nodes = self.forces = self._room("nodes", self.node_count, self._node)
        if self._keeps_excess:
            self.forces = self._room("forces", self.node_count, self._node)
        kernels.place_columns(self._arrays["bases"], self._arrays["starts"], self._tiles, self.columns, self.owners)

    def _room(self, name: str, length: int, element: Any = None) -> Any:
        """Return an array of at least this length, new only where the last one is too short."""
        import taichi as ti

        if name not in self._arrays or self._arrays[name].shape[0] < length:
            room = int(HEADROOM * length)
            if self._on_processor:
                require_room(room * 4 * (8 if element else 1), length)
            self._arrays.pop(name, None)
            self._arrays[name] = ti.ndarray(element or ti.i32, room)
        return self._arrays[name]

    def sort(self, positions: Any) -> None:
        """Find the order of the particles, and the runs that threads may own."""
        from slideframe_mpm_taichi import kernels

        kernels.key_particles(positions, self.columns, self.corner, self.across, self._keys)
        starts = self._room("particle_starts", self.node_count + 1)
        kernels.count_keys(self._keys, starts, self.node_count)
        by_tile = starts.to_numpy()[self._node_starts]
        kernels.rank_particles(self._keys, starts, self.order)
        share = (len(by_tile) - 1) // COLOURS
        cuts = [runs(by_tile[first : first + share + 1], self._most_runs) for first in range(0, COLOURS * share, share)]
        values: npt.NDArray[np.int32] = np.zeros((COLOURS, self._most_runs, 2), np.int32)
        for colour, cut in enumerate(cuts):
            values[colour, : len(cut)] = np.array(cut, np.int32).reshape(-1, 2)
        self._runs.from_numpy(values)
        self.runs = self._runs, [len(cut) for cut in cuts]
