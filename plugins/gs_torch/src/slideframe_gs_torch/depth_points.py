"""The survey's sparse points as depths that a view should show."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Camera

# Of the points in one cell of this many px the nearest is taken: those behind it may be hidden.
CELL_PX = 8
# A relative error beyond this counts linearly: a point that another part of the scene hides must not pull it apart.
ROBUST_SHARE = 0.02


@dataclass(frozen=True)
class DepthPoints:
    """Pixels of a view, rows and columns (point,), and their depths (point,), m along the view axis."""

    rows: Tensor
    columns: Tensor
    depths: Tensor

    def loss(self, depth: Tensor, alpha: Tensor) -> Tensor:
        """Return the mean robust relative error of a drawn depth (height, width), where anything is drawn."""
        drawn, seen = depth[self.rows, self.columns], alpha[self.rows, self.columns].detach()
        error = torch.where(seen > 0.5, drawn / self.depths - 1, 0.0)
        loss: Tensor = torch.nn.functional.huber_loss(error, torch.zeros_like(error), delta=ROBUST_SHARE) / ROBUST_SHARE
        return loss


def depth_points(points: Float32Array, camera: Camera, world_from_camera: Float64Array) -> DepthPoints | None:
    """Project sparse points (point, 3) into a view; None where it sees none."""
    local = (points - world_from_camera[:, 3]) @ world_from_camera[:, :3]
    local = local[local[:, 2] > 0]
    columns = np.floor(camera.focal_x * local[:, 0] / local[:, 2] + camera.principal_x)
    rows = np.floor(camera.focal_y * local[:, 1] / local[:, 2] + camera.principal_y)
    inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    rows, columns, depths = (values[inside] for values in (rows, columns, local[:, 2]))
    cells = rows // CELL_PX * (camera.width // CELL_PX + 1) + columns // CELL_PX
    order = np.lexsort((depths, cells))
    nearest = order[np.unique(cells[order], return_index=True)[1]]
    if not len(nearest):
        return None
    indices = [torch.from_numpy(values[nearest].astype(np.int64)) for values in (rows, columns)]
    return DepthPoints(*indices, torch.from_numpy(depths[nearest].astype(np.float32)))
