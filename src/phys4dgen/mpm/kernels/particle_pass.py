"""Grid to particles, constitutive law, particles to grid: one pass over a range of sorted particles of one law.

MLS-MPM with APIC transfers and quadratic B-splines. Particle mathematics runs on a batch of particles at once, the
transfers particle by particle on rows of 16 lanes = 4 neighbouring nodes along z times (vx, vy, vz, mass). Particles
come sorted by cell, so the nine rows around a cell are loaded once and its momentum is accumulated in registers.

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
    group_sums,
    load_group_each,
    load_group_repeated,
    load_transposed_batch,
    store_transposed,
)

__all__ = ["address_of_pass", "call_pass"]

_f = np.float32
_FETCHED = -(-SUBSTEP_COLUMNS // LANES)  # columns that each lane fetches
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
    """Write each particle's weights (rows of 16: x . y . z .) and its lowest node; returns its offset in cells."""
    shift_x, shift_y, shift_z, ny, nz = grid
    node_x, fx, wx = _axis_weights(position[0], inverse_dx, shift_x, bounds[0], bounds[1])
    node_y, fy, wy = _axis_weights(position[1], inverse_dx, shift_y, bounds[2], bounds[3])
    node_z, fz, wz = _axis_weights(position[2], inverse_dx, shift_z, bounds[4], bounds[5])
    store(nodes, 0, ((node_x * ny + node_y) * nz + node_z) * 4)
    o = like(fx, _f(0))
    wx0, wx1, wx2 = wx
    wy0, wy1, wy2 = wy
    wz0, wz1, wz2 = wz
    store_transposed(weights, 0, (wx0, wx1, wx2, o, wy0, wy1, wy2, o, wz0, wz1, wz2, o, o, o, o, o))
    return fx, fy, fz


@inline
def _add_rows(momentum, at, sy, a0, a1, a2):
    store(momentum, at, load16(momentum, at) + a0)
    store(momentum, at + sy, load16(momentum, at + sy) + a1)
    store(momentum, at + 2 * sy, load16(momentum, at + 2 * sy) + a2)


@inline
def _gather(velocity, weights, nodes, gathered, sx, sy, particles, stride, coming):
    """Interpolate velocity and B of every particle of the batch: rows [v . | B_x . | B_y . | B_z .].

    Meanwhile the columns of the batch at ``coming`` are fetched, few at a time so that they do not wait for each other;
    laws see to their own.
    """
    kz = _z_offset()
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
        o = lane * 16
        y0, y1, y2 = splat16(weights[o + 4]), splat16(weights[o + 5]), splat16(weights[o + 6])
        t0 = y0 * r00
        u0 = y2 * r02 - t0
        t0 = t0 + y1 * r01 + y2 * r02
        t1 = y0 * r10
        u1 = y2 * r12 - t1
        t1 = t1 + y1 * r11 + y2 * r12
        t2 = y0 * r20
        u2 = y2 * r22 - t2
        t2 = t2 + y1 * r21 + y2 * r22
        x0, x1, x2 = splat16(weights[o]), splat16(weights[o + 1]), splat16(weights[o + 2])
        wz = load_group_each(weights, o + 8)
        t0 = x0 * t0
        t2 = x2 * t2
        s = (t0 + x1 * t1 + t2) * wz
        store(gathered, o, group_sums(s, (t2 - t0) * wz, (x0 * u0 + x1 * u1 + x2 * u2) * wz, s * kz))


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
    weights = np.empty(LANES * 16, np.float32)
    rows = np.empty(LANES * 16, np.float32)
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
            _gather(velocity, weights, nodes, rows, sx, sy, particles, stride, batch + AHEAD)
            v0, v1, v2, _0, b00, b10, b20, _1, b01, b11, b21, _2, b02, b12, b22, _3 = load_transposed_batch(rows, 0)
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
        store_transposed(rows, 0, (p0, p1, p2, mass, a_xx, a_yx, a_zx, o, a_xy, a_yy, a_zy, o, a_xz, a_yz, a_zz, o))
        for lane in range(LANES):
            at = nodes[lane]
            if at != pending:
                if pending >= 0:
                    _add_rows(momentum, pending, sy, a00, a01, a02)
                    _add_rows(momentum, pending + sx, sy, a10, a11, a12)
                    _add_rows(momentum, pending + 2 * sx, sy, a20, a21, a22)
                pending = at
                a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = zero
            r = lane * 16
            wz = load_group_each(weights, r + 8)
            centre = wz * (load_group_repeated(rows, r) + kz * load_group_repeated(rows, r + 12))
            along_x = wz * load_group_repeated(rows, r + 4)
            along_y = wz * load_group_repeated(rows, r + 8)
            y0, y1, y2 = splat16(weights[r + 4]), splat16(weights[r + 5]), splat16(weights[r + 6])
            w = splat16(weights[r])
            s = w * (centre - along_x)
            d = w * along_y
            a00, a01, a02 = a00 + y0 * (s - d), a01 + y1 * s, a02 + y2 * (s + d)
            w = splat16(weights[r + 1])
            s = w * centre
            d = w * along_y
            a10, a11, a12 = a10 + y0 * (s - d), a11 + y1 * s, a12 + y2 * (s + d)
            w = splat16(weights[r + 2])
            s = w * (centre + along_x)
            d = w * along_y
            a20, a21, a22 = a20 + y0 * (s - d), a21 + y1 * s, a22 + y2 * (s + d)
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
