"""What the particles of one chunk do in a substep: the particle pass of each law, and the steps of rigid bodies."""

from __future__ import annotations

import numpy as np
from numba.core import types

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.layout import FUSED, GATHER_ONLY, SCATTER_ONLY, inner_kernel
from phys4dgen.mpm.kernels.particle_pass import call_pass
from phys4dgen.mpm.kernels.rigid_pass import clear_sums, place_rigid, sum_rigid
from phys4dgen.mpm.kernels.sorting import take_sorted
from phys4dgen.vector.memory import flat

__all__ = ["address_of_chunk_pass", "call_chunk_pass", "rigid_chunk"]


@inner_kernel
def _grid_of(grid, first_plane):
    """The grid as particles of the velocity field that begins with a plane see it."""
    return grid[0] - first_plane, grid[1], grid[2], grid[3], grid[4]


@inner_kernel
def _chunk_pass(
    chunk, stage, particle_pass, laws, soft, ranges, fields, unsorted, particles, order, velocity, momentum, grid,
    nodes_x, bounds, dx, dt, kicks, coming,
):  # fmt: skip
    """The particle pass over one chunk: first of all particles, which are sorted then, later of soft ones.

    Arguments as ``step.advance``, and the chunk, the stage, how many laws are soft, and the number of the kicks.
    """
    columns = flat(particles)
    stride = particles.shape[1]
    inverse_dx = np.float32(1) / dx
    kick = kicks[coming]
    for law in range(len(laws) if stage == SCATTER_ONLY else soft):
        first, last = ranges[law, chunk, 0], ranges[law, chunk, 1]
        if stage == SCATTER_ONLY:
            take_sorted(unsorted, particles, order, first, last)
        own_grid = _grid_of(grid, fields[law] * nodes_x)
        call_pass(
            particle_pass, laws[law], stage, first, last, columns, stride, velocity, momentum[chunk], own_grid,
            bounds[law, chunk], inverse_dx, dt, kick,
        )  # fmt: skip


@inner_kernel
def rigid_chunk(
    chunk, gathers, stage, particle_pass, laws, ranges, fields, particles, velocity, momentum, grid, nodes_x, bounds,
    dx, dt, kicks, coming, rigid,
):  # fmt: skip
    """What rigid particles of one chunk do before their groups move (``gathers``) and after; as ``step.advance``."""
    columns = flat(particles)
    stride = particles.shape[1]
    inverse_dx = np.float32(1) / dx
    kick = kicks[coming]
    soft, unblocked, group_of, offsets, constraint, motion, sums = rigid[:7]
    for law in range(soft, len(laws)):
        first, last = ranges[law, chunk, 0], ranges[law, chunk, 1]
        own_grid = _grid_of(grid, fields[law] * nodes_x)
        if gathers:
            call_pass(
                particle_pass, laws[law], GATHER_ONLY, first, last, columns, stride, unblocked, momentum[chunk],
                own_grid, bounds[law, chunk], inverse_dx, dt, kick,
            )  # fmt: skip
            if law == soft:
                clear_sums(sums[chunk])
            sum_rigid(particles, first, last, group_of, offsets, motion, dx, sums[chunk])
        else:
            place_rigid(particles, first, last, group_of, offsets, motion, constraint)
            if stage == FUSED:
                call_pass(
                    particle_pass, laws[law], SCATTER_ONLY, first, last, columns, stride, velocity, momentum[chunk],
                    own_grid, bounds[law, chunk], inverse_dx, dt, kick,
                )  # fmt: skip


_ARGUMENTS = (
    types.int64,  # chunk
    types.int64,  # stage
    types.int64,  # particle_pass
    types.Array(types.int64, 1, "C"),  # laws
    types.int64,  # soft
    types.Array(types.int64, 3, "C"),  # ranges
    types.Array(types.int64, 1, "C"),  # fields
    types.Array(types.float32, 2, "C"),  # unsorted
    types.Array(types.float32, 2, "C"),  # particles
    types.Array(types.int32, 1, "C"),  # order
    FLOATS,  # velocity
    types.Array(types.float32, 2, "C"),  # momentum
    types.UniTuple(types.int64, 5),  # grid
    types.int64,  # nodes_x
    types.Array(types.int32, 3, "C"),  # bounds
    types.float32,  # dx
    types.float32,  # dt
    types.Array(types.float32, 3, "C"),  # kicks
    types.int64,  # coming
)

call_chunk_pass = caller_of(_ARGUMENTS)
"""Inside kernels: the pass over a chunk by the function at an address, with its arguments."""


def address_of_chunk_pass() -> int:
    """Address of the pass over a chunk; compiled or taken from Numba's cache at the first call."""
    return address_of(_chunk_pass, _ARGUMENTS)
