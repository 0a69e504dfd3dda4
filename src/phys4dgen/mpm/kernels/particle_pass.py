"""Grid to particles, constitutive law, particles to grid: one pass over a range of sorted particles of one law.

MLS-MPM with APIC transfers and quadratic B-splines. Particle mathematics runs on a batch of particles at once, the
transfers particle by particle on rows of 16 lanes = 4 neighbouring nodes along z times (vx, vy, vz, mass). Particles
come sorted by cell, so the nine rows around a cell are loaded once and its momentum is accumulated in registers. What
a row gets or gives is weighted by the product of its weights along x and y, which the batch computes for all at once.

Symbols: fx, fy, fz offset of a particle from its central node in cells; B = sum_i w_i v_i (x_i - x_p)^T / dx;
C = 4/dx B is the affine velocity matrix, the node's momentum is w_i (m v + A (x_i - x_p)/dx) with
A = 4 m B - 4/dx dt V0 tau.

Sources: C. Jiang et al., *The affine particle-in-cell method*, SIGGRAPH 2015; Y. Hu et al., *A moving least squares
material point method*, SIGGRAPH 2018, eq. 16-18; X. Wang et al., *A massively parallel and scalable multi-GPU MPM*,
SIGGRAPH 2020 (fused grid-to-particle-to-grid). Paper: Sec. C.2.
"""

from __future__ import annotations

import numpy as np
from numba.core import types

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.law_step import STRESS, VELOCITY_GRADIENT, call_law
from phys4dgen.mpm.kernels.layout import (
    AFFINE,
    AHEAD,
    FUSED,
    GATHER_ONLY,
    LANES,
    LOAD,
    MASS,
    POSITION,
    POSITION_REST,
    SCATTER_ONLY,
    SUBSTEP_COLUMNS,
    VELOCITY,
    VOLUME,
    inner_kernel,
)
from phys4dgen.vector.float_state import begin_flush_to_zero, restore_float_state
from phys4dgen.vector.lanes import add_compensated, constant16, floor, like, maximum, minimum, splat16, to_int
from phys4dgen.vector.math import inline
from phys4dgen.vector.memory import load16, load_batch, load_columns, prefetch_columns, store, store_columns
from phys4dgen.vector.shuffles import (
    load_group_each,
    load_group_moments,
    load_group_repeated,
    place_of_four,
    store_in_fours,
)

__all__ = ["address_of_pass", "call_pass"]

_f = np.float32
_FETCHED = -(-SUBSTEP_COLUMNS // LANES)  # columns that each lane fetches
_ALONG_Z = 9 * LANES  # where the weights along z are, after those of the nine rows
_AROUND_X, _AROUND_Y = 16 * LANES, 32 * LANES  # where moments about the central node are, after velocities
_z_offset = constant16([-1] * 4 + [0] * 4 + [1] * 4 + [0] * 4)


@inline
def _advance3(particles, at, rest_at, stride, values, steps):
    """Add steps to values with compensated rounding; stores both columns and returns the new values."""
    a, a_rest = add_compensated(values[0], load_batch(particles, rest_at), steps[0])
    b, b_rest = add_compensated(values[1], load_batch(particles, rest_at + stride), steps[1])
    c, c_rest = add_compensated(values[2], load_batch(particles, rest_at + 2 * stride), steps[2])
    store_columns(particles, at, stride, (a, b, c))
    store_columns(particles, rest_at, stride, (a_rest, b_rest, c_rest))
    return a, b, c


@inline
def _axis_weights(x, inverse_dx, shift, low, high):
    """Lowest node, offset from the central node in cells, and the three B-spline weights along one axis.

    The node is kept within [low, high] whatever x is, so that no write can leave the grid.
    """
    in_cells = x * inverse_dx
    below = floor(in_cells - _f(0.5))
    node = maximum(minimum(to_int(below) - shift, high), low)
    offset = in_cells - below - _f(1)
    a = _f(0.5) - offset
    b = _f(0.5) + offset
    return node, offset, (_f(0.5) * a * a, _f(0.75) - offset * offset, _f(0.5) * b * b)


@inline
def _prepare_weights(position, grid, bounds, inverse_dx, weights, nodes):
    """Write each particle's weights and its lowest node; returns its offset in cells.

    Weights: a column of LANES for each of the nine rows, the product of those along x and y, and from ``_ALONG_Z`` on
    the fours (three along z, 0).
    """
    shift_x, shift_y, shift_z, ny, nz = grid
    node_x, fx, wx = _axis_weights(position[0], inverse_dx, shift_x, bounds[0], bounds[1])
    node_y, fy, wy = _axis_weights(position[1], inverse_dx, shift_y, bounds[2], bounds[3])
    node_z, fz, wz = _axis_weights(position[2], inverse_dx, shift_z, bounds[4], bounds[5])
    store(nodes, 0, ((node_x * ny + node_y) * nz + node_z) * 4)
    x0, x1, x2 = wx
    y0, y1, y2 = wy
    z0, z1, z2 = wz
    of_rows = x0 * y0, x0 * y1, x0 * y2, x1 * y0, x1 * y1, x1 * y2, x2 * y0, x2 * y1, x2 * y2
    store_columns(weights, 0, LANES, of_rows)
    store_in_fours(weights, _ALONG_Z, (z0, z1, z2, like(fx, _f(0))))
    return fx, fy, fz


@inline
def _add_rows(momentum, at, sy, a0, a1, a2):
    store(momentum, at, load16(momentum, at) + a0)
    store(momentum, at + sy, load16(momentum, at + sy) + a1)
    store(momentum, at + 2 * sy, load16(momentum, at + 2 * sy) + a2)


@inline
def _gather(velocity, weights, nodes, gathered, sx, sy, particles, stride, coming):
    """Weigh the grid's velocity for every particle of the batch, summed over x and y but not over the nodes along z.

    Three blocks of LANES rows [node below: v . | central node: v . | node above: v . | unused]: velocities that sum to
    v; from ``_AROUND_X`` and ``_AROUND_Y`` on, what sums to the moments B + v f about the central node along x and y.
    That along z is the first block's (``load_group_moments``).

    Meanwhile the columns of the batch at ``coming`` are fetched, few at a time so that they do not wait for each other;
    laws see to their own.
    """
    current = np.int32(-1)
    zero = splat16(_f(0))
    r00 = r01 = r02 = r10 = r11 = r12 = r20 = r21 = r22 = zero
    for lane in range(LANES):
        if lane * _FETCHED < SUBSTEP_COLUMNS:
            prefetch_columns(particles, lane * _FETCHED * stride + coming, stride, _FETCHED)
        at = nodes[lane]
        if at != current:
            current = at
            r00, r01, r02 = load16(velocity, at), load16(velocity, at + sy), load16(velocity, at + 2 * sy)
            at += sx
            r10, r11, r12 = load16(velocity, at), load16(velocity, at + sy), load16(velocity, at + 2 * sy)
            at += sx
            r20, r21, r22 = load16(velocity, at), load16(velocity, at + sy), load16(velocity, at + 2 * sy)
        p00 = splat16(weights[lane]) * r00
        p01 = splat16(weights[lane + LANES]) * r01
        p02 = splat16(weights[lane + 2 * LANES]) * r02
        p10 = splat16(weights[lane + 3 * LANES]) * r10
        p11 = splat16(weights[lane + 4 * LANES]) * r11
        p12 = splat16(weights[lane + 5 * LANES]) * r12
        p20 = splat16(weights[lane + 6 * LANES]) * r20
        p21 = splat16(weights[lane + 7 * LANES]) * r21
        p22 = splat16(weights[lane + 8 * LANES]) * r22
        wz = load_group_each(weights, _ALONG_Z + place_of_four(lane))
        left = p00 + p02 + p01  # each row's middle one last: it is used once and fuses with its sum
        right = p20 + p22 + p21
        row = 16 * lane
        store(gathered, row, (left + (p10 + p12 + p11) + right) * wz)
        store(gathered, row + _AROUND_X, (right - left) * wz)
        store(gathered, row + _AROUND_Y, (p02 + p12 + p22 - (p00 + p10 + p20)) * wz)


@inner_kernel
def _particle_pass(law, stage, first, last, particles, stride, velocity, momentum, grid, bounds, inverse_dx, dt, kicks):
    """Advance particles [first, last) of one law by one substep and scatter what the next one needs.

    Args:
        law: address of the constitutive law (``law_step.address_of_law``).
        stage: SCATTER_ONLY, FUSED or GATHER_ONLY.
        first: first particle of the range.
        last: one past its last; both are multiples of LANES.
        particles: the columns of ``layout``, flat, float32.
        stride: length of one column.
        velocity: grid velocities (vx, vy, vz, .) per node, m/s, flat float32.
        momentum: this chunk's private grid (px, py, pz, mass) per node, flat float32; added to.
        grid: (shift_x, shift_y, shift_z, ny, nz): first node of the grid in world cells, nodes along y and z.
        bounds: lowest and highest permitted lowest node of a particle along x, y, z, six int.
        inverse_dx: cells per metre, float32.
        dt: substep in seconds, float32.
        kicks: what loads do to a particle's velocity v in the coming substep, by its LOAD: v <- v + k - beta v,
            (k, beta) in m/s and as a share, [rows, 4]; [0, 4] if none.
    """
    state = begin_flush_to_zero()
    weights = np.empty(13 * LANES, np.float32)
    gathered = np.empty(48 * LANES, np.float32)
    rows = np.empty(16 * LANES, np.float32)
    nodes = np.empty(LANES, np.int32)
    kick = np.empty(LANES * 4, np.float32)
    ny, nz = grid[3], grid[4]
    sy = nz * 4
    sx = ny * sy
    shift = (np.int32(grid[0]), np.int32(grid[1]), np.int32(grid[2]), np.int32(ny), np.int32(nz))
    kz = _z_offset()
    zero = splat16(_f(0))
    pending = -1  # cell whose momentum is being accumulated
    a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = zero
    for batch in range(first, last, LANES):
        position = load_columns(particles, POSITION * stride + batch, stride, 3)
        fx, fy, fz = _prepare_weights(position, shift, bounds, inverse_dx, weights, nodes)
        if stage == SCATTER_ONLY:
            v0, v1, v2 = load_columns(particles, VELOCITY * stride + batch, stride, 3)
            c = load_columns(particles, AFFINE * stride + batch, stride, 9)
            law_dt = _f(0)  # the state is that of this moment
        else:
            _gather(velocity, weights, nodes, gathered, sx, sy, particles, stride, batch + AHEAD)
            v0, v1, v2, _0, b02, b12, b22, _1 = load_group_moments(gathered, 0)
            b00, b10, b20 = load_group_moments(gathered, _AROUND_X)[:3]
            b01, b11, b21 = load_group_moments(gathered, _AROUND_Y)[:3]
            k = _f(4) * inverse_dx
            c00, c10, c20 = k * (b00 - v0 * fx), k * (b10 - v1 * fx), k * (b20 - v2 * fx)
            c01, c11, c21 = k * (b01 - v0 * fy), k * (b11 - v1 * fy), k * (b21 - v2 * fy)
            c02, c12, c22 = k * (b02 - v0 * fz), k * (b12 - v1 * fz), k * (b22 - v2 * fz)
            c = (c00, c01, c02, c10, c11, c12, c20, c21, c22)
            at = POSITION * stride + batch
            rest_at = POSITION_REST * stride + batch
            position = _advance3(particles, at, rest_at, stride, position, (v0 * dt, v1 * dt, v2 * dt))
            law_dt = dt
        store_columns(rows, VELOCITY_GRADIENT, LANES, c)
        call_law(law, particles, batch, stride, rows, law_dt)
        if stage == GATHER_ONLY:
            store_columns(particles, VELOCITY * stride + batch, stride, (v0, v1, v2))
            store_columns(particles, AFFINE * stride + batch, stride, load_columns(rows, VELOCITY_GRADIENT, LANES, 9))
            continue
        if stage == FUSED:
            fx, fy, fz = _prepare_weights(position, shift, bounds, inverse_dx, weights, nodes)
        if kicks.shape[0] > 0:
            for lane in range(LANES):
                row = np.int64(particles[LOAD * stride + batch + lane])
                kick[lane] = kicks[row, 0]
                kick[LANES + lane] = kicks[row, 1]
                kick[2 * LANES + lane] = kicks[row, 2]
                kick[3 * LANES + lane] = kicks[row, 3]
            beta = load_batch(kick, 3 * LANES)
            v0 = v0 + load_batch(kick, 0) - beta * v0
            v1 = v1 + load_batch(kick, LANES) - beta * v1
            v2 = v2 + load_batch(kick, 2 * LANES) - beta * v2
        mass = load_batch(particles, MASS * stride + batch)
        m = mass / inverse_dx  # so that 4 m B = m dx C
        q = load_batch(particles, VOLUME * stride + batch) * (_f(-4) * inverse_dx * dt)
        t00, t01, t02, t11, t12, t22 = load_columns(rows, STRESS, LANES, 6)
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = load_columns(rows, VELOCITY_GRADIENT, LANES, 9)
        a_xx, a_xy, a_xz = m * c00 + q * t00, m * c01 + q * t01, m * c02 + q * t02
        a_yx, a_yy, a_yz = m * c10 + q * t01, m * c11 + q * t11, m * c12 + q * t12
        a_zx, a_zy, a_zz = m * c20 + q * t02, m * c21 + q * t12, m * c22 + q * t22
        # momentum at the central node, from where A carries it to the others
        p0 = mass * v0 - a_xx * fx - a_xy * fy - a_xz * fz
        p1 = mass * v1 - a_yx * fx - a_yy * fy - a_yz * fz
        p2 = mass * v2 - a_zx * fx - a_zy * fy - a_zz * fz
        o = like(mass, _f(0))
        store_in_fours(rows, 0, (p0, p1, p2, mass))
        store_in_fours(rows, 4 * LANES, (a_xx, a_yx, a_zx, o))
        store_in_fours(rows, 8 * LANES, (a_xy, a_yy, a_zy, o))
        store_in_fours(rows, 12 * LANES, (a_xz, a_yz, a_zz, o))
        for lane in range(LANES):
            at = nodes[lane]
            if at != pending:
                if pending >= 0:
                    _add_rows(momentum, pending, sy, a00, a01, a02)
                    _add_rows(momentum, pending + sx, sy, a10, a11, a12)
                    _add_rows(momentum, pending + 2 * sx, sy, a20, a21, a22)
                pending = at
                a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = zero
            four = place_of_four(lane)
            wz = load_group_each(weights, _ALONG_Z + four)
            centre = wz * (load_group_repeated(rows, four) + kz * load_group_repeated(rows, four + 12 * LANES))
            along_x = wz * load_group_repeated(rows, four + 4 * LANES)
            along_y = wz * load_group_repeated(rows, four + 8 * LANES)
            side = centre - along_x
            a00 = a00 + splat16(weights[lane]) * (side - along_y)
            a01 = a01 + splat16(weights[lane + LANES]) * side
            a02 = a02 + splat16(weights[lane + 2 * LANES]) * (side + along_y)
            a10 = a10 + splat16(weights[lane + 3 * LANES]) * (centre - along_y)
            a11 = a11 + splat16(weights[lane + 4 * LANES]) * centre
            a12 = a12 + splat16(weights[lane + 5 * LANES]) * (centre + along_y)
            side = centre + along_x
            a20 = a20 + splat16(weights[lane + 6 * LANES]) * (side - along_y)
            a21 = a21 + splat16(weights[lane + 7 * LANES]) * side
            a22 = a22 + splat16(weights[lane + 8 * LANES]) * (side + along_y)
    if pending >= 0:
        _add_rows(momentum, pending, sy, a00, a01, a02)
        _add_rows(momentum, pending + sx, sy, a10, a11, a12)
        _add_rows(momentum, pending + 2 * sx, sy, a20, a21, a22)
    restore_float_state(state)


_ARGUMENTS = (
    types.int64,  # law
    types.int64,  # stage
    types.int64,  # first
    types.int64,  # last
    FLOATS,  # particles
    types.int64,  # stride
    FLOATS,  # velocity
    FLOATS,  # momentum
    types.UniTuple(types.int64, 5),  # grid
    types.Array(types.int32, 1, "C"),  # bounds
    types.float32,  # inverse_dx
    types.float32,  # dt
    types.Array(types.float32, 2, "C"),  # kicks
)

call_pass = caller_of(_ARGUMENTS)
"""Inside kernels: the particle pass at an address, with its arguments."""


def address_of_pass() -> int:
    """Address of the particle pass; compiled or taken from Numba's cache at the first call."""
    return address_of(_particle_pass, _ARGUMENTS)
