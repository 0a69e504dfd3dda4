"""The kernel that finds scales and quaternions of deformed Gaussians, continuing those of the frame before.

Layout and slices are those of ``kernels``: 16 Gaussians at once, one per lane.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from phys4dgen.animate.kernels import load3, load_matrices
from phys4dgen.vector.float_state import begin_flush_to_zero, restore_float_state
from phys4dgen.vector.lanes import absolute, any_lane, like, maximum, splat16, sqrt, where
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import matmul
from phys4dgen.vector.memory import load16, store
from phys4dgen.vector.shuffles import store_transposed

__all__ = ["axes_slice"]

_MAX_SWEEPS = 12  # of the one-sided Jacobi iteration; three are usual
_COSINE_TOLERANCE = 1e-6  # columns that close to a right angle count as orthogonal

_f = np.float32


@inline
def _load9(values, at):
    a, b, c = load3(values, at)
    d, e, f = load3(values, at + 48)
    g, h, i = load3(values, at + 96)
    return a, b, c, d, e, f, g, h, i


@inline
def _make_orthogonal(p, q, vp, vq):
    """Turn columns p and q of G, and of V with them, until they are orthogonal: the smaller of the two angles."""
    pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    qq = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    pq = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    turn = pq * pq > _f(_COSINE_TOLERANCE * _COSINE_TOLERANCE) * (pp * qq)
    h = qq - pp
    g = pq + pq
    tangent = g / (absolute(h) + sqrt(h * h + g * g) + _f(1e-35))
    tangent = where(h < _f(0), -tangent, tangent)
    tangent = where(turn, tangent, like(tangent, _f(0)))
    c = where(turn, _f(1) / sqrt(_f(1) + tangent * tangent), like(tangent, _f(1)))
    s = c * tangent
    return (
        turn,
        (c * p[0] - s * q[0], c * p[1] - s * q[1], c * p[2] - s * q[2]),
        (s * p[0] + c * q[0], s * p[1] + c * q[1], s * p[2] + c * q[2]),
        (c * vp[0] - s * vq[0], c * vp[1] - s * vq[1], c * vp[2] - s * vq[2]),
        (s * vp[0] + c * vq[0], s * vp[1] + c * vq[1], s * vp[2] + c * vq[2]),
    )


@inline
def _orthonormalised(v):
    """One Newton step V (3 - V^T V) / 2 against the drift of many frames."""
    m = matmul((v[0], v[3], v[6], v[1], v[4], v[7], v[2], v[5], v[8]), v)
    a, b, c = _f(1.5) - _f(0.5) * m[0], _f(-0.5) * m[1], _f(-0.5) * m[2]
    d, e, f = _f(1.5) - _f(0.5) * m[4], _f(-0.5) * m[5], _f(1.5) - _f(0.5) * m[8]
    return matmul(v, (a, b, c, b, d, e, c, e, f))


@inline
def _quaternion(a, b, c):
    """Unit quaternion (w, x, y, z) of the rotation with columns a, b, c (Shepperd's method, all four cases at once)."""
    trace = a[0] + b[1] + c[2]
    best = _f(1) + trace
    w, x, y, z = best, b[2] - c[1], c[0] - a[2], a[1] - b[0]
    ww = _f(1) + a[0] - b[1] - c[2]
    use = ww > best
    best = where(use, ww, best)
    w, x, y, z = where(use, b[2] - c[1], w), where(use, ww, x), where(use, b[0] + a[1], y), where(use, c[0] + a[2], z)
    ww = _f(1) - a[0] + b[1] - c[2]
    use = ww > best
    best = where(use, ww, best)
    w, x, y, z = where(use, c[0] - a[2], w), where(use, b[0] + a[1], x), where(use, ww, y), where(use, c[1] + b[2], z)
    ww = _f(1) - a[0] - b[1] + c[2]
    use = ww > best
    w, x, y, z = where(use, a[1] - b[0], w), where(use, c[0] + a[2], x), where(use, c[1] + b[2], y), where(use, ww, z)
    inverse = _f(1) / sqrt(w * w + x * x + y * y + z * z)
    return w * inverse, x * inverse, y * inverse, z * inverse


@inline
def _unit(p):
    """Length and direction of a column."""
    length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    inverse = _f(1) / maximum(length, like(length, _f(1e-18)))
    return length, (p[0] * inverse, p[1] * inverse, p[2] * inverse)


@inline
def _departure_from_identity(f):
    one = _f(1)
    diagonal = absolute(f[0] - one) + absolute(f[4] - one) + absolute(f[8] - one)
    return (
        diagonal + absolute(f[1]) + absolute(f[2]) + absolute(f[3]) + absolute(f[5]) + absolute(f[6]) + absolute(f[7])
    )


@njit(cache=True, nogil=True, error_model="numpy")
def axes_slice(
    part, parts, deformation, rest_axes, order, unsort, turned, previous, rest_quats, rest_scales, quats, scales
):
    """Scales and quaternions of Sigma' = G G^T, G = F R_0 S_0, with axes that follow those of the frame before.

    One-sided Jacobi (Hestenes): G V has orthogonal columns, whose lengths are the scales and whose directions are the
    axes. V starts from the frame before, so the columns start nearly orthogonal and keep their identity, and equal
    scales leave V as it is. It never squares the scales: the smallest keeps its relative accuracy however thin the
    Gaussian is (Demmel and Veselic 1992), where an eigen-decomposition of Sigma' loses it. Inside, the columns are
    sorted by length at rest, and the longest is cleared from the others first: else what little of it two short
    columns of equal length share would turn them about.

    Args:
        part: which of the ``parts`` equal slices of the blocks to do.
        parts: number of slices.
        deformation: [N, 9] float32.
        rest_axes: R_0 S_0 / s with the longest column first, a proper basis, and the largest scale s; blocked, 10
            components.
        order: scale of the input that each sorted column is, [N, 3] int32.
        unsort: quaternion that takes sorted axes back to the input's order, blocked, 4 components.
        turned: in and out, V, blocked, 9 components.
        previous: in and out, quaternion of the frame before, blocked, 4 components.
        rest_quats: [N, 4] float32, given back as they are where F = 1 and V = 1.
        rest_scales: [N, 3] float32, likewise.
        quats: out, [N, 4] float32, in the hemisphere of the frame before.
        scales: out, [N, 3] float32.
    """
    state = begin_flush_to_zero()
    n = deformation.shape[0]
    blocks = previous.shape[0] // 64
    rows = np.zeros(256, np.float32)
    zero = splat16(_f(0))
    one = splat16(_f(1))
    for block in range(blocks * part // parts, blocks * (part + 1) // parts):
        first = 16 * block
        f = load_matrices(deformation, first, n, rows)
        v = _orthonormalised(_load9(turned, 144 * block))
        g = matmul(matmul(f, _load9(rest_axes, 160 * block)), v)
        size = load16(rest_axes, 160 * block + 144)
        a, b, c = (g[0], g[3], g[6]), (g[1], g[4], g[7]), (g[2], g[5], g[8])
        va, vb, vc = (v[0], v[3], v[6]), (v[1], v[4], v[7]), (v[2], v[5], v[8])
        for _ in range(_MAX_SWEEPS):
            turn_ab, a, b, va, vb = _make_orthogonal(a, b, va, vb)
            turn_ac, a, c, va, vc = _make_orthogonal(a, c, va, vc)
            turn_bc, b, c, vb, vc = _make_orthogonal(b, c, vb, vc)
            if not any_lane(turn_ab | turn_ac | turn_bc):
                break
        v = (va[0], vb[0], vc[0], va[1], vb[1], vc[1], va[2], vb[2], vc[2])
        for k in range(3):
            store(turned, 144 * block + 48 * k, va[k])
            store(turned, 144 * block + 48 * k + 16, vb[k])
            store(turned, 144 * block + 48 * k + 32, vc[k])
        length_a, a = _unit(a)
        length_b, b = _unit(b)
        length_c, c = _unit(c)
        sw, sx, sy, sz = _quaternion(a, b, c)
        uw, ux, uy = load3(unsort, 64 * block)
        uz = load16(unsort, 64 * block + 48)
        w = sw * uw - sx * ux - sy * uy - sz * uz
        x = sw * ux + sx * uw + sy * uz - sz * uy
        y = sw * uy - sx * uz + sy * uw + sz * ux
        z = sw * uz + sx * uy - sy * ux + sz * uw
        pw, px, py = load3(previous, 64 * block)
        pz = load16(previous, 64 * block + 48)
        flip = w * pw + x * px + y * py + z * pz < zero
        w, x, y, z = where(flip, -w, w), where(flip, -x, x), where(flip, -y, y), where(flip, -z, z)
        store(previous, 64 * block, w)
        store(previous, 64 * block + 16, x)
        store(previous, 64 * block + 32, y)
        store(previous, 64 * block + 48, z)
        moved = where(_departure_from_identity(f) + _departure_from_identity(v) > zero, one, zero)
        scale_a, scale_b, scale_c = length_a * size, length_b * size, length_c * size
        store_transposed(
            rows,
            0,
            (w, x, y, z, scale_a, scale_b, scale_c, moved, zero, zero, zero, zero, zero, zero, zero, zero),
        )
        for lane in range(min(16, n - first)):
            i = first + lane
            rest = rows[16 * lane + 7] == _f(0)
            for k in range(4):
                quats[i, k] = rest_quats[i, k] if rest else rows[16 * lane + k]
            for k in range(3):
                column = order[i, k]
                scales[i, column] = rest_scales[i, column] if rest else rows[16 * lane + 4 + k]
    restore_float_state(state)
