"""Kernels that order particles by cell, so that threads own slabs of the grid and memory is read in sequence."""

import taichi as ti

from .arrays import Array
from .transfers import SLAB_WIDTH


@ti.func
def cell_of(position, stride):
    """Return the flat index of the first node of a particle's stencil."""
    first = ti.cast(position - 0.5, ti.i32)
    return first[0] * stride[0] + first[1] * stride[1] + first[2]


@ti.kernel
def count_cells(positions: Array, stride: ti.types.vector(2, ti.i32), starts: Array):
    """Leave in `starts[cell]` the number of particles in all cells before `cell`."""
    for cell in range(starts.shape[0]):
        starts[cell] = 0
    ti.loop_config(serialize=True)
    for particle in range(positions.shape[0]):
        starts[cell_of(positions[particle], stride)] += 1
    for _ in range(1):
        total = 0
        for cell in range(starts.shape[0]):
            count = starts[cell]
            starts[cell] = total
            total += count


@ti.kernel
def split_slabs(starts: Array, stride: ti.types.vector(2, ti.i32), particle_count: ti.i32, slab_starts: Array):
    """Find the first particle of each slab of SLAB_WIDTH layers of cells."""
    for slab in range(slab_starts.shape[0]):
        cell = slab * SLAB_WIDTH * stride[0]
        slab_starts[slab] = particle_count
        if cell < starts.shape[0]:
            slab_starts[slab] = starts[cell]


@ti.kernel
def rank_particles(positions: Array, stride: ti.types.vector(2, ti.i32), starts: Array, order: Array):
    """Write into `order` the particles cell by cell; equals keep their order. Uses up `starts`."""
    ti.loop_config(serialize=True)
    for particle in range(positions.shape[0]):
        cell = cell_of(positions[particle], stride)
        order[starts[cell]] = particle
        starts[cell] += 1


@ti.kernel
def reorder(order: Array, source: Array, target: Array):
    """Copy an array of particles into the new order."""
    for place in range(order.shape[0]):
        target[place] = source[order[place]]
