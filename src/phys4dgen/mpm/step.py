"""What happens in a substep, on one page.

A *segment* is a run of substeps between two sorts of the particles:

1. sort      particles are put in the order of their cells;
2. scatter   each particle gives its mass, its momentum and the impulse of its stress to 27 grid nodes;
3. substeps  (a) grid: momentum / mass = velocity; accelerate, damp, hold, meet obstacles;
             (b) particles: read velocity v and its gradient C back, x += dt v, F <- (I + dt C) F, ask the
                 constitutive law for the stress, and scatter again for the next substep;
4. gather    the last substep ends with (b) but for its scatter: x, v, C and F are then the whole state.

Rigid particles split (b): they read v and C back; then (c) the momenta of each rigid group are summed, the group meets
the ground and moves, and its particles are put into their new places and scatter.

Time integration is symplectic Euler. All threads work on all of (a) by planes and on (b) by chunks of particles; a
chunk owns a private momentum grid, so nothing is shared and the result does not depend on the number of threads.

Paper: Sec. C.2, Algorithm 1 of Y. Hu et al., *A moving least squares material point method*, SIGGRAPH 2018.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import prange

from phys4dgen.mpm.kernels.chunk_pass import address_of_chunk_pass, call_chunk_pass, rigid_chunk
from phys4dgen.mpm.kernels.grid_pass import address_of_grid_plane, call_grid_plane
from phys4dgen.mpm.kernels.layout import FUSED, GATHER_ONLY, SCATTER_ONLY, parallel_kernel
from phys4dgen.mpm.kernels.pair_contact import address_of_limit_pairs
from phys4dgen.mpm.kernels.particle_pass import address_of_pass
from phys4dgen.mpm.kernels.rigid_pass import move_rigid

__all__ = ["advance", "kernels_for"]

_GRID, _PARTICLES, _RIGID = 0, 1, 2  # phases of a substep; all threads finish one before the next begins


@cache
def kernels_for(fields: int) -> tuple[int, int, int, int]:
    """Addresses of the kernels that a scene of so many velocity fields needs, as ``advance`` takes them."""
    limit_pairs = address_of_limit_pairs() if fields > 1 else 0
    return address_of_grid_plane(), limit_pairs, address_of_chunk_pass(), address_of_pass()


@parallel_kernel
def advance(
    kernels,
    laws,
    unsorted,
    particles,
    order,
    ranges,
    fields,
    spans,
    bounds,
    momentum,
    velocity,
    free,
    contacts,
    pairs,
    grid,
    nodes_x,
    dx,
    dt,
    gains,
    kicks,
    damping,
    undamped,
    rigid,
):
    """Sort the particles, then advance them by one segment.

    Args:
        kernels: addresses of what does (a) and (b): ``grid_pass.address_of_grid_plane``,
            ``pair_contact.address_of_limit_pairs`` or 0 where there is one velocity field,
            ``chunk_pass.address_of_chunk_pass`` and ``particle_pass.address_of_pass``.
        laws: address of each law present (``law_step.address_of_law``), int64 [laws].
        unsorted: particle columns as the last segment left them, float32 [columns, stride].
        particles: result, the same columns in the new order.
        order: order[i] is the place in ``unsorted`` of the particle that comes to place i, int32 [stride].
        ranges: first and one past last particle of each law in each chunk, int64 [laws, chunks, 2].
        fields: velocity field of each law, int64 [laws].
        spans: nodes along z that each chunk may write to, by plane and row, int32 [chunks, fields nx, ny, 2].
        bounds: permitted lowest nodes of the particles of each law in each chunk, int32 [laws, chunks, 6].
        momentum: private momentum grids, zero, float32 [chunks, 4 fields nodes + 64].
        velocity: grid velocity, float32 [4 fields nodes + 64].
        free: 1 where a node may move, else 0, float32 [nodes + 64].
        contacts: nodes where something limits the velocity (``contacts.contact_arrays``).
        pairs: nodes where fields meet (``velocity_fields``).
        grid: (shift_x, shift_y, shift_z, ny, nz), int.
        nodes_x: nodes along x of one field, int.
        dx: cell side, m, float32.
        dt: substep, s, float32.
        gains: velocity that every node gains in each substep, m/s, float32 [substeps, 3].
        kicks: what loads do to velocities of particles, by row (``forces.Kicks``), float32 [substeps or 1, rows, 4].
        damping: share of the velocity relative to ``undamped`` lost per substep, float32.
        undamped: rigid motion that damping spares in each substep, float32 [substeps, 9] (see ``grid_plane``).
        rigid: None, or ``RigidParts.kernel_arguments``; the last laws of ``ranges`` are then those of rigid particles.
    """
    grid_plane, limit_pairs, chunk_pass, particle_pass = kernels
    substeps = len(gains)
    chunks = spans.shape[0]
    phases = 2 if rigid is None else 3
    soft = len(laws) if rigid is None else rigid[0]
    unblocked = velocity[:0] if rigid is None else rigid[1]
    for substep in range(substeps + 1):
        now, coming = max(substep - 1, 0), min(substep, len(kicks) - 1)
        stage = SCATTER_ONLY if substep == 0 else GATHER_ONLY if substep == substeps else FUSED
        for phase in range(_PARTICLES if substep == 0 else _GRID, 2 if substep == 0 else phases):
            if rigid is not None and phase == _RIGID:
                gain = gains[now]
                resting = np.sqrt(gain[0] * gain[0] + gain[1] * gain[1] + gain[2] * gain[2])
                move_rigid(*rigid[5:], resting, np.float64(dt))
            items = nodes_x if phase == _GRID else chunks
            for index in prange(items):
                item = np.int64(index)  # unsigned inside the loop alone: the callees would be compiled for both
                if phase == _GRID:
                    call_grid_plane(
                        grid_plane, item, nodes_x, spans, momentum, velocity, unblocked, free, contacts, limit_pairs,
                        pairs, grid, dx, dt, gains, damping, undamped, now,
                    )  # fmt: skip
                elif phase == _PARTICLES:
                    call_chunk_pass(
                        chunk_pass, item, stage, particle_pass, laws, soft, ranges, fields, unsorted, particles, order,
                        velocity, momentum, grid, nodes_x, bounds, dx, dt, kicks, coming,
                    )  # fmt: skip
                if rigid is not None and stage != SCATTER_ONLY and phase != _GRID:
                    rigid_chunk(
                        item, phase == _PARTICLES, stage, particle_pass, laws, ranges, fields, particles, velocity,
                        momentum, grid, nodes_x, bounds, dx, dt, kicks, coming, rigid,
                    )  # fmt: skip
