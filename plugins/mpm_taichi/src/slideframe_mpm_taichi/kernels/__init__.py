"""The kernels of the explicit MLS-MPM: one module for each concern, with the same names in the same order in Warp's.

Positions are in cells from the grid's origin; everything else is SI. The elastic state of a particle is
X = b_e - 1 (elastic left Cauchy-Green tensor minus identity) as (xx, yy, zz, yz, xz, xy): small strains
stay small numbers, which a deformation gradient near 1 loses in float32. Between the kernels of one
substep a particle carries `affines` = spacing * (mass * C - stress term), all that the next scatter needs.

`float` is the runtime's default_fp, so one source serves both precisions. Taichi needs annotations as
objects: no `from __future__ import annotations` in these modules.
"""

from .boundaries import update_grid
from .materials import return_mapping
from .rendering import bound_stretch
from .transfers import CHUNK, SLAB_WIDTH, grid_to_particles, particles_to_grid, particles_to_grid_atomic

__all__ = [
    "CHUNK",
    "SLAB_WIDTH",
    "bound_stretch",
    "grid_to_particles",
    "particles_to_grid",
    "particles_to_grid_atomic",
    "return_mapping",
    "update_grid",
]
