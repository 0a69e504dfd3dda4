"""Particles at rest as a linear operator on the displacements of the grid, with the particle pass of the engine.

Displacements stand in the place of velocities, with a substep of one second: the pass reads their gradient back, which
becomes the deformation gradient, and what it gives to the grid is the impulse of the stress. They are so small that
every law is linear and that no particle moves by as much as a bit (``stiffness.Stiffness``).
"""

from __future__ import annotations

import numpy as np
from numba import prange

from phys4dgen.mpm.kernels.compiled_pass import call_pass
from phys4dgen.mpm.kernels.layout import DISPLACEMENT_GRADIENT, SCATTER_ONLY, parallel_kernel, strict_kernel

__all__ = ["put_on_grid", "strain_and_scatter", "take_from_grid"]


@parallel_kernel
def strain_and_scatter(
    passes, stage, particles, ranges, planes, velocity, momentum, grid, bounds, inverse_dx, kicks, rest_column
):
    """One pass over all particles, each strained by the displacements on the grid from nothing.

    Args:
        passes: address of the particle pass of each range (``address_of_pass``), int64 [ranges].
        stage: of the pass: SCATTER_ONLY what the particles have, FUSED read and scatter, GATHER_ONLY read and keep.
        particles: the columns of ``layout``, sorted by cell, float32 [columns, stride].
        ranges: first and one past last particle of each range in each chunk, int64 [ranges, chunks, 2].
        planes: first plane of each range's velocity field, int64 [ranges].
        velocity: displacements (x, y, z, .) per node, m, flat float32.
        momentum: private grids, float32 [chunks, ..]; added to.
        grid: (shift_x, shift_y, shift_z, ny, nz).
        bounds: permitted lowest nodes, int32 [ranges, chunks, 6].
        inverse_dx: cells per metre, float32.
        kicks: [0, 4], float32.
        rest_column: first of nine that hold what rounding took from the deformation gradient.
    """
    flat = particles.ravel()
    stride = particles.shape[1]
    for chunk in prange(ranges.shape[1]):
        for number in range(len(passes)):
            first, last = ranges[number, chunk]
            if stage != SCATTER_ONLY:
                particles[DISPLACEMENT_GRADIENT : DISPLACEMENT_GRADIENT + 9, first:last] = 0
                particles[rest_column : rest_column + 9, first:last] = 0
            own_grid = (grid[0] - planes[number], grid[1], grid[2], grid[3], grid[4])
            call_pass(
                passes[number], stage, first, last, flat, stride, velocity, momentum[chunk], own_grid,
                bounds[number, chunk], inverse_dx, np.float32(1), kicks,
            )  # fmt: skip


@strict_kernel
def put_on_grid(values, factors, places, velocity):
    """Set the first three numbers at each of n nodes to values [n, 3] times factors [n].

    Args:
        values: one vector per node.
        factors: one number per node.
        places: where the node stands in the grid, int64 [n].
        velocity: result, flat float32.
    """
    for i in range(len(places)):
        for axis in range(3):
            velocity[places[i] + axis] = values[i, axis] * factors[i]


@strict_kernel
def take_from_grid(momentum, places, factors, sums):
    """Sum what the chunks gave to each of n nodes, times factors [n], and set it to zero again.

    Args:
        momentum: private grids, float32 [chunks, ..].
        places: where the node stands in a private grid, int64 [n].
        factors: one number per node.
        sums: result, three components and mass, float64 [n, 4].
    """
    for i in range(len(places)):
        for component in range(4):
            at = places[i] + component
            total = 0.0
            for chunk in range(momentum.shape[0]):
                total += momentum[chunk, at]
                momentum[chunk, at] = 0
            sums[i, component] = total * factors[i]
