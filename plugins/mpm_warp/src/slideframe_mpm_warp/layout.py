"""Where the grid's nodes are and in what order particles lie, so that memory follows the particles, not the box."""

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from slideframe.tiles import COLOURS, HEADROOM, LARGEST_INDEX, TILE, require_room, runs, window


class Layout:
    """The nodes under the particles of one simulation; valid until a particle has moved by a cell.

    Attributes:
        corner: indices i, j of the first column.
        across: columns in a row.
        columns: (columns,), what to add to a layer's index k to find a column's node.
        owners: (nodes,), each node's column.
        nodes: (nodes,), momentum or velocity, and mass.
        forces: (nodes,), impulse of stress, or velocity before it, where a transfer keeps them; else `nodes`.
        order: (n,), the particles in the order of their first nodes.
    """

    def __init__(self, kernels: ModuleType, device: str, particle_count: int) -> None:
        """Have no nodes yet."""
        import warp as wp

        self._kernels, self._device, self._count = kernels, device, particle_count
        self._bounds: Any = wp.zeros(4, dtype=int, device=device)
        # radix sort needs as much room again
        self._keys: Any = wp.zeros(2 * particle_count, dtype=int, device=device)
        self._places: Any = wp.zeros(2 * particle_count, dtype=int, device=device)
        self.order: Any = self._places[:particle_count]
        self._arrays: dict[str, Any] = {}

    def arrange(self, positions: Any) -> None:
        """Lay columns under the particles and find their order."""
        import warp as wp

        with wp.ScopedDevice(self._device):
            self._place_window(positions)
            self._place_tiles(positions)
            self._place_nodes()
            inputs = [positions, self.columns, self.corner, self.across, self._keys, self._places]
            wp.launch(self._kernels.key_particles, dim=self._count, inputs=inputs)
            wp.utils.radix_sort_pairs(self._keys, self._places, self._count)

    def _place_window(self, positions: Any) -> None:
        """Find the tiles that hold particles, and take one more on each side, and an even number of them."""
        import warp as wp

        most = LARGEST_INDEX
        self._bounds.assign(np.array([most, most, -most, -most], np.int32))
        wp.launch(self._kernels.bound_columns, dim=self._count, inputs=[positions, self._bounds])
        corner, self._tiles = window(*self._bounds.numpy().reshape(2, 2))
        self.corner = wp.vec2i(*corner)
        self.across = self._tiles[1] * TILE

    def _place_tiles(self, positions: Any) -> None:
        """Give each tile as many nodes as the particles in it and around it need."""
        import warp as wp

        kernels, tiles, count = self._kernels, wp.vec2i(*self._tiles), self._tiles[0] * self._tiles[1]
        lowest, highest, bases, sizes = (
            self._room(name, count + 1) for name in ("lowest", "highest", "bases", "sizes")
        )
        lowest.fill_(LARGEST_INDEX)
        highest.fill_(-LARGEST_INDEX)
        sizes.zero_()
        wp.launch(kernels.bound_tiles, dim=self._count, inputs=[positions, self.corner, tiles, lowest, highest])
        wp.launch(kernels.size_tiles, dim=count, inputs=[lowest, highest, tiles, bases, sizes])
        self._starts = self._room("starts", count + 1)
        wp.utils.array_scan(sizes, self._starts, inclusive=False)

    def _place_nodes(self) -> None:
        import warp as wp

        self._node_starts: npt.NDArray[np.int32] = self._starts.numpy()
        self.node_count = int(self._node_starts[-1])
        self.columns = self._room("columns", len(self._node_starts[1:]) * TILE**2)
        self.owners = self._room("owners", self.node_count)
        self.nodes = self.forces = self._room("nodes", self.node_count, self._kernels.Vector4)
        if self._kernels.KEEPS_EXCESS:
            self.forces = self._room("forces", self.node_count, self._kernels.Vector4)
        inputs = [self._arrays["bases"], self._starts, wp.vec2i(*self._tiles), self.columns, self.owners]
        wp.launch(self._kernels.place_columns, dim=len(self.columns), inputs=inputs)

    def _room(self, name: str, length: int, element: Any = int) -> Any:
        """Return an array of this length, new only where the last one is too short."""
        import warp as wp

        kept = self._arrays.get(name)
        if kept is None or len(kept) < length:
            room = int(HEADROOM * length)
            size = room * wp.types.type_size_in_bytes(element)
            if self._device == "cpu":
                require_room(size, length)
            self._arrays.pop(name, None)
            kept = self._arrays[name] = wp.zeros(room, dtype=element)
        return kept[:length]

    def cut(self, parts: int) -> list[list[tuple[int, int]]]:
        """Return for each colour of tiles at most `parts` runs of particles (first, count) that share no node."""
        keys = self._keys.numpy()[: self._count]
        starts = np.searchsorted(keys, self._node_starts)
        share = (len(starts) - 1) // COLOURS
        return [runs(starts[colour * share : (colour + 1) * share + 1], parts) for colour in range(COLOURS)]
