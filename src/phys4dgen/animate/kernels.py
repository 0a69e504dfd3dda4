"""The per-Gaussian kernels: blend the particles' motion, polar rotation, covariance.

Each works on blocks of 16 Gaussians, one per lane. Constant inputs come in *blocked* layout: component c of lane l of
block b at [(b C + c) 16 + l], padded to whole blocks, so that a component is one vector load (``blocked``). Results
leave through a 16 x 16 scratch that turns lanes into rows. Every Gaussian is computed alone, so neither the number of
slices nor their order changes a bit of the result.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from phys4dgen.vector.float_state import begin_flush_to_zero, restore_float_state
from phys4dgen.vector.lanes import any_lane, like, splat16, where
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import determinant, matmul
from phys4dgen.vector.memory import load16, store
from phys4dgen.vector.shuffles import load_transposed16, store_transposed

__all__ = ["LANES", "blocked", "carry_slice", "covariance_slice", "load3", "load_matrices", "polar_slice"]

LANES = 16

_NEWTON_STEPS = 6

_f = np.float32


def blocked(values: NDArray[Any]) -> NDArray[np.float32]:
    """Rows [N, C] in blocked layout, the last block filled up with zeros; flat, float32."""
    n, components = values.shape
    blocks = -(-n // LANES)
    padded = np.zeros((blocks * LANES, components), np.float32)
    padded[:n] = values
    return np.ascontiguousarray(padded.reshape(blocks, LANES, components).transpose(0, 2, 1)).ravel()


@inline
def load3(values, at):
    """Three components of a block in blocked layout, the first at ``values[at]``."""
    return load16(values, at), load16(values, at + 16), load16(values, at + 32)


@inline
def load_matrices(matrices, first, n, rows):
    """Row-major matrices [N, 9] number ``first`` to ``first + 15`` as nine lanes; beyond the end: the last one."""
    for lane in range(16):
        i = min(first + lane, n - 1)
        for c in range(9):
            rows[16 * lane + c] = matrices[i, c]
    m = load_transposed16(rows, 0)
    return m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]


@inline
def _newton_rotation(f):
    """Rotation of F = R S by Newton's iteration X <- (X + X^-T) / 2 (Higham 1986); 1 where det F <= 0.

    Six steps reach float32 accuracy for singular values from 0.1 to 10.
    """
    x = f
    volume = determinant(f)
    one = like(volume, _f(1))
    proper = volume > _f(1e-6)
    for _ in range(_NEWTON_STEPS):
        x0, x1, x2, x3, x4, x5, x6, x7, x8 = x
        c0, c1, c2 = x4 * x8 - x5 * x7, x5 * x6 - x3 * x8, x3 * x7 - x4 * x6
        half = _f(0.5) / where(proper, x0 * c0 + x1 * c1 + x2 * c2, one)
        x = (
            _f(0.5) * x0 + half * c0,
            _f(0.5) * x1 + half * c1,
            _f(0.5) * x2 + half * c2,
            _f(0.5) * x3 + half * (x2 * x7 - x1 * x8),
            _f(0.5) * x4 + half * (x0 * x8 - x2 * x6),
            _f(0.5) * x5 + half * (x1 * x6 - x0 * x7),
            _f(0.5) * x6 + half * (x1 * x5 - x2 * x4),
            _f(0.5) * x7 + half * (x2 * x3 - x0 * x5),
            _f(0.5) * x8 + half * (x0 * x4 - x1 * x3),
        )
    zero = like(volume, _f(0))
    return (
        where(proper, x[0], one),
        where(proper, x[1], zero),
        where(proper, x[2], zero),
        where(proper, x[3], zero),
        where(proper, x[4], one),
        where(proper, x[5], zero),
        where(proper, x[6], zero),
        where(proper, x[7], zero),
        where(proper, x[8], one),
    )


@inline
def _is_positive_definite(a00, a01, a02, a11, a12, a22):
    """Sylvester's criterion: all leading minors of the symmetric matrix are positive."""
    minor = a00 * a11 - a01 * a01
    third = a02 * (a01 * a12 - a11 * a02) - a12 * (a00 * a12 - a01 * a02) + a22 * minor
    zero = _f(0)
    return (a00 > zero) & (minor > zero) & (third > zero)


@njit(cache=True, nogil=True, error_model="numpy")
def carry_slice(
    part,
    parts,
    motion,
    particles,
    weights,
    means,
    centred,
    rigidity,
    arm,
    positions,
    deformation,
):
    """Blend the motion: x = sum w (x_p + F_p (X - X_p)), F = sum w F_p, rigid where the skin says so.

    The blend is linear, so it is done on the twelve numbers of each particle's affine displacement field
    c + H (X - O), H = F_p - 1, and evaluated once per Gaussian. Displacements, not positions: rest stays rest to the
    bit, and no digits are lost far from the origin.

    Args:
        part: which of the ``parts`` equal slices of the blocks to do.
        parts: number of slices.
        motion: per particle 16 floats: c (3), H (9, row by row), x_p - X_p (3), unused; flat [16 P].
        particles: [N padded, 8] int32.
        weights: [N padded, 8] float32, 0 in the padding.
        means: rest positions, [N, 3] float32.
        centred: rest positions X - O, blocked, 3 components.
        rigidity: 0 affine .. 1 rotation only, blocked, 1 component.
        arm: lever arm of the rigid motion, blocked, 3 components.
        positions: out, [N, 3] float32.
        deformation: out, [N, 9] float32.
    """
    state = begin_flush_to_zero()
    n = means.shape[0]
    blocks = rigidity.shape[0] // 16
    rows = np.zeros(256, np.float32)
    one = splat16(_f(1))
    zero = splat16(_f(0))
    for block in range(blocks * part // parts, blocks * (part + 1) // parts):
        first = 16 * block
        for lane in range(16):
            i = first + lane
            blend = weights[i, 0] * load16(motion, 16 * particles[i, 0])
            for k in range(1, 8):
                blend = blend + weights[i, k] * load16(motion, 16 * particles[i, k])
            store(rows, 16 * lane, blend)
        m = load_transposed16(rows, 0)
        x0, x1, x2 = load3(centred, 48 * block)
        d0 = m[0] + m[3] * x0 + m[4] * x1 + m[5] * x2
        d1 = m[1] + m[6] * x0 + m[7] * x1 + m[8] * x2
        d2 = m[2] + m[9] * x0 + m[10] * x1 + m[11] * x2
        h0, h1, h2, h3, h4, h5, h6, h7, h8 = m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10], m[11]
        b = load16(rigidity, first)
        if any_lane(b > _f(0)):
            r = _newton_rotation((one + h0, h1, h2, h3, one + h4, h5, h6, h7, one + h8))
            a0, a1, a2 = load3(arm, 48 * block)
            t0, t1, t2 = r[0] - one, r[4] - one, r[8] - one
            d0 = d0 + b * (m[12] + t0 * a0 + r[1] * a1 + r[2] * a2 - d0)
            d1 = d1 + b * (m[13] + r[3] * a0 + t1 * a1 + r[5] * a2 - d1)
            d2 = d2 + b * (m[14] + r[6] * a0 + r[7] * a1 + t2 * a2 - d2)
            h0, h1, h2 = h0 + b * (t0 - h0), h1 + b * (r[1] - h1), h2 + b * (r[2] - h2)
            h3, h4, h5 = h3 + b * (r[3] - h3), h4 + b * (t1 - h4), h5 + b * (r[5] - h5)
            h6, h7, h8 = h6 + b * (r[6] - h6), h7 + b * (r[7] - h7), h8 + b * (t2 - h8)
        store_transposed(
            rows, 0, (d0, d1, d2, one + h0, h1, h2, h3, one + h4, h5, h6, h7, one + h8, zero, zero, zero, zero)
        )
        for lane in range(min(16, n - first)):
            i = first + lane
            for c in range(3):
                positions[i, c] = means[i, c] + rows[16 * lane + c]
            for c in range(9):
                deformation[i, c] = rows[16 * lane + 3 + c]
    restore_float_state(state)


@njit(cache=True, nogil=True, error_model="numpy")
def polar_slice(part, parts, deformation, lower, upper, rotations, overstretched):
    """Polar rotation R of F = R S, and whether a singular value of F leaves [lower, upper] (or det F <= 0).

    The bounds are tested without finding the singular values: S - lower and upper - S must be positive definite.

    Args:
        part: which of the ``parts`` equal slices of the blocks to do.
        parts: number of slices.
        deformation: [N, 9] float32.
        lower: at least 0.1, float32.
        upper: at most 10, float32.
        rotations: out, [N, 9] float32; not to be relied on where overstretched.
        overstretched: out, [N] bool.
    """
    n = deformation.shape[0]
    blocks = (n + 15) // 16
    rows = np.zeros(256, np.float32)
    zero = splat16(_f(0))
    one = splat16(_f(1))
    for block in range(blocks * part // parts, blocks * (part + 1) // parts):
        first = 16 * block
        f = load_matrices(deformation, first, n, rows)
        r = _newton_rotation(f)
        s00 = r[0] * f[0] + r[3] * f[3] + r[6] * f[6]
        s11 = r[1] * f[1] + r[4] * f[4] + r[7] * f[7]
        s22 = r[2] * f[2] + r[5] * f[5] + r[8] * f[8]
        s01 = _f(0.5) * (r[0] * f[1] + r[3] * f[4] + r[6] * f[7] + r[1] * f[0] + r[4] * f[3] + r[7] * f[6])
        s02 = _f(0.5) * (r[0] * f[2] + r[3] * f[5] + r[6] * f[8] + r[2] * f[0] + r[5] * f[3] + r[8] * f[6])
        s12 = _f(0.5) * (r[1] * f[2] + r[4] * f[5] + r[7] * f[8] + r[2] * f[1] + r[5] * f[4] + r[8] * f[7])
        inside = _is_positive_definite(s00 - lower, s01, s02, s11 - lower, s12, s22 - lower)
        inside = inside & _is_positive_definite(upper - s00, -s01, -s02, upper - s11, -s12, upper - s22)
        flag = where(inside, zero, one)
        store_transposed(
            rows,
            0,
            (r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], flag, zero, zero, zero, zero, zero, zero),
        )
        for lane in range(min(16, n - first)):
            for c in range(9):
                rotations[first + lane, c] = rows[16 * lane + c]
            overstretched[first + lane] = rows[16 * lane + 9] > _f(0)


@njit(cache=True, nogil=True, error_model="numpy")
def covariance_slice(part, parts, deformation, covariances, deformed):
    """Sigma' = F Sigma F^T.

    Args:
        part: which of the ``parts`` equal slices of the blocks to do.
        parts: number of slices.
        deformation: [N, 9] float32.
        covariances: at rest, blocked, 6 components xx xy xz yy yz zz.
        deformed: out, [N, 6] float32, in that order.
    """
    n = deformation.shape[0]
    blocks = (n + 15) // 16
    rows = np.zeros(256, np.float32)
    zero = splat16(_f(0))
    for block in range(blocks * part // parts, blocks * (part + 1) // parts):
        first = 16 * block
        f = load_matrices(deformation, first, n, rows)
        sxx, sxy, sxz = load3(covariances, 96 * block)
        syy, syz, szz = load3(covariances, 96 * block + 48)
        g = matmul(f, (sxx, sxy, sxz, sxy, syy, syz, sxz, syz, szz))
        xx = g[0] * f[0] + g[1] * f[1] + g[2] * f[2]
        xy = g[0] * f[3] + g[1] * f[4] + g[2] * f[5]
        xz = g[0] * f[6] + g[1] * f[7] + g[2] * f[8]
        yy = g[3] * f[3] + g[4] * f[4] + g[5] * f[5]
        yz = g[3] * f[6] + g[4] * f[7] + g[5] * f[8]
        zz = g[6] * f[6] + g[7] * f[7] + g[8] * f[8]
        store_transposed(rows, 0, (xx, xy, xz, yy, yz, zz, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero))
        for lane in range(min(16, n - first)):
            for c in range(6):
                deformed[first + lane, c] = rows[16 * lane + c]
