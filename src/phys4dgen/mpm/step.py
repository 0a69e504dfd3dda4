"""What happens in a substep, on one page.

A *segment* is a run of substeps between two sorts of the particles:

1. sort      particles are put in the order of their cells;
2. scatter   each particle gives its mass, its momentum and the impulse of its stress to 27 grid nodes;
3. substeps  (a) grid: momentum / mass = velocity; accelerate, damp, hold;
             (b) particles: read velocity v and its gradient C back, x += dt v, F <- (I + dt C) F, ask the
                 constitutive law for the stress, and scatter again for the next substep;
4. gather    the last substep ends with (b) but for its scatter: x, v, C and F are then the whole state.

Time integration is symplectic Euler. All threads work on all of (a) by planes and on (b) by chunks of particles; a
chunk owns a private momentum grid, so nothing is shared and the result does not depend on the number of threads.

Paper: Sec. C.2, Algorithm 1 of Y. Hu et al., *A moving least squares material point method*, SIGGRAPH 2018.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numba.extending import overload

from phys4dgen.mpm.kernels.grid_pass import grid_plane
from phys4dgen.mpm.kernels.layout import FUSED, GATHER_ONLY, SCATTER_ONLY, parallel_kernel
from phys4dgen.mpm.kernels.particle_pass import particle_pass

__all__ = ["advance"]


@parallel_kernel
def advance(
    laws,
    unsorted,
    particles,
    order,
    ranges,
    spans,
    bounds,
    momentum,
    velocity,
    free,
    grid,
    dx,
    dt,
    gains,
    kicks,
    damping,
    rigid,
):
    """Sort the particles, then advance them by one segment.

    Args:
        laws: tuple of the constitutive laws present.
        unsorted: particle columns as the last segment left them, float32 [columns, stride].
        particles: result, the same columns in the new order.
        order: order[i] is the place in ``unsorted`` of the particle that comes to place i, int32 [stride].
        ranges: first and one past last particle of each law in each chunk, int64 [laws, chunks, 2].
        spans: nodes along z that each chunk may write to, by plane and row, int32 [chunks, nx, ny, 2].
        bounds: permitted lowest nodes of the particles of each chunk, int32 [chunks, 6].
        momentum: private momentum grids, zero, float32 [chunks, 4 nodes + 64].
        velocity: grid velocity, float32 [4 nodes + 64].
        free: 1 where a node may move, else 0, float32 [nodes + 64].
        grid: (shift_x, shift_y, shift_z, ny, nz), int.
        dx: cell side, m, float32.
        dt: substep, s, float32.
        gains: velocity that every node gains in each substep, m/s, float32 [substeps, 3].
        kicks: velocity that each part gains in each substep, m/s, float32 [substeps, parts or 0, 3].
        damping: share of the velocity relative to ``rigid`` lost per substep, float32.
        rigid: undamped rigid motion in each substep, float32 [substeps, 9] (see ``grid_plane``).
    """
    for column in prange(particles.shape[0]):
        for i in range(particles.shape[1]):
            particles[column, i] = unsorted[column, order[i]]
    substeps = len(gains)
    chunks = spans.shape[0]
    inverse_dx = np.float32(1) / dx
    flat = particles.ravel()
    stride = particles.shape[1]
    for substep in range(substeps + 1):
        if substep == 0:
            stage = SCATTER_ONLY
        else:
            for plane in prange(spans.shape[1]):
                now = substep - 1
                grid_plane(plane, spans, momentum, velocity, free, grid, dx, gains[now], damping, rigid[now])
            stage = GATHER_ONLY if substep == substeps else FUSED
        coming = min(substep, substeps - 1)
        for chunk in prange(chunks):
            arguments = (flat, stride, velocity, momentum[chunk], grid, bounds[chunk], inverse_dx, dt, kicks[coming])
            _pass_all_laws(laws, ranges, chunk, stage, arguments)


def _pass_all_laws(laws, ranges, chunk, stage, arguments):
    """``particle_pass`` for each law in turn; compiled only, see the overload below."""
    raise NotImplementedError("_pass_all_laws works inside compiled kernels only.")


@overload(_pass_all_laws)
def _unroll(laws, ranges, chunk, stage, arguments):
    """One call per law of the tuple, resolved while compiling, so that each is the law's own specialised kernel."""
    if len(laws) == 0:

        def nothing(laws, ranges, chunk, stage, arguments):
            pass

        return nothing

    def first_then_rest(laws, ranges, chunk, stage, arguments):
        first, last = ranges[-len(laws), chunk]
        particle_pass(laws[0], stage, first, last, *arguments)
        _pass_all_laws(laws[1:], ranges, chunk, stage, arguments)

    return first_then_rest
