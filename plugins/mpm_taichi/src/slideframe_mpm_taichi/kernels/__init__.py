"""The kernels of the explicit MLS-MPM: one module for each concern, with the same names in the same order in Warp's.

Positions are in cells from the grid's origin; everything else is SI. The elastic state of a particle is
X = b_e - 1 (elastic left Cauchy-Green tensor minus identity) as (xx, yy, zz, yz, xz, xy): small strains
stay small numbers, which a deformation gradient near 1 loses in float32. Between the kernels of one
substep a particle carries `affines` = spacing * (mass * C - stress term), all that the next scatter needs; where
particles keep a share of their own velocity (slideframe.problem.transfer), the stress terms are apart, in `pulls`.

`float` is the runtime's default_fp, so one source serves both precisions. Taichi needs annotations as
objects: no `from __future__ import annotations` in these modules.
"""

from .boundaries import clear_grid, update_grid
from .layout import (
    bound_columns,
    bound_tiles,
    count_keys,
    key_particles,
    place_columns,
    rank_particles,
    reorder,
    size_tiles,
)
from .materials import return_mapping
from .rendering import bound_stretch
from .transfers import (
    MOST_RUNS,
    grid_to_particles,
    particles_to_grid,
    particles_to_grid_atomic,
    retime,
    strain_particles,
)

__all__ = [
    "MOST_RUNS",
    "bound_columns",
    "bound_stretch",
    "bound_tiles",
    "clear_grid",
    "count_keys",
    "grid_to_particles",
    "key_particles",
    "particles_to_grid",
    "particles_to_grid_atomic",
    "place_columns",
    "rank_particles",
    "reorder",
    "retime",
    "return_mapping",
    "size_tiles",
    "strain_particles",
    "update_grid",
]
