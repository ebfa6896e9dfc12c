"""The kernels of the explicit MLS-MPM: one module for each concern, with the same names in the same order in Taichi's.

Positions are in cells from the grid's origin; everything else is SI. The elastic state of a particle is
X = b_e - 1 (elastic left Cauchy-Green tensor minus identity) as (xx, yy, zz, yz, xz, xy): small strains
stay small numbers, which a deformation gradient near 1 loses in float32. Between the kernels of one
substep a particle carries `affines` = spacing * (mass * C - stress term), all that the next scatter needs; where
particles keep a share of their own velocity (slideframe.problem.transfer), the stress terms are apart, in `pulls`.

Warp mixes no precisions, so `runtime` loads this package once for each, under a name of its own, with `precision`,
`shared_nodes` and `keeps_excess` set beforehand; that is why its modules import one another relatively.
"""

from .boundaries import update_grid
from .layout import bound_columns, bound_tiles, key_particles, place_columns, reorder, size_tiles
from .materials import Soil, return_mapping
from .reals import KEEPS_EXCESS, LANES, Matrix, Real, Vector, Vector2, Vector4, Vector6
from .rendering import bound_stretch
from .transfers import CHUNK, grid_to_particles, particles_to_grid, retime, strain_particles

__all__ = [
    "CHUNK",
    "KEEPS_EXCESS",
    "LANES",
    "Matrix",
    "Real",
    "Soil",
    "Vector",
    "Vector2",
    "Vector4",
    "Vector6",
    "bound_columns",
    "bound_stretch",
    "bound_tiles",
    "grid_to_particles",
    "key_particles",
    "particles_to_grid",
    "place_columns",
    "reorder",
    "retime",
    "return_mapping",
    "size_tiles",
    "strain_particles",
    "update_grid",
]
