"""3 x 3 matrices on lanes: products, determinants, symmetric eigen-decomposition, singular values, polar rotation.

A 3 x 3 matrix is a tuple of nine float lanes, row by row; a symmetric one is six: (00, 01, 02, 11, 12, 22). All
functions are for use inside ``numba.njit`` and are inlined into their caller.
"""

from __future__ import annotations

import numpy as np

from phys4dgen.vector.lanes import absolute, any_lane, like, maximum, root_and_inverse, sqrt, where
from phys4dgen.vector.math import inline

__all__ = [
    "determinant",
    "identity_plus",
    "left_cauchy_green",
    "matmul",
    "matmul_transposed",
    "polar_rotation",
    "singular_value_decomposition",
    "symmetric_eigen",
    "symmetric_from_eigen",
    "volume_growth",
]

_f = np.float32


@inline
def determinant(a):
    """Determinant of a 3 x 3 matrix."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = a
    return a00 * (a11 * a22 - a12 * a21) - a01 * (a10 * a22 - a12 * a20) + a02 * (a10 * a21 - a11 * a20)


@inline
def identity_plus(a):
    """I + A."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = a
    return a00 + _f(1), a01, a02, a10, a11 + _f(1), a12, a20, a21, a22 + _f(1)


@inline
def volume_growth(a):
    """det(I + A) - 1, with all digits where A is small."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = a
    minors = a00 * a11 - a01 * a10 + a00 * a22 - a02 * a20 + a11 * a22 - a12 * a21
    return (a00 + a11 + a22) + minors + determinant(a)


@inline
def matmul(a, b):
    """Product A B."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = a
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = b
    return (
        a00 * b00 + a01 * b10 + a02 * b20,
        a00 * b01 + a01 * b11 + a02 * b21,
        a00 * b02 + a01 * b12 + a02 * b22,
        a10 * b00 + a11 * b10 + a12 * b20,
        a10 * b01 + a11 * b11 + a12 * b21,
        a10 * b02 + a11 * b12 + a12 * b22,
        a20 * b00 + a21 * b10 + a22 * b20,
        a20 * b01 + a21 * b11 + a22 * b21,
        a20 * b02 + a21 * b12 + a22 * b22,
    )


@inline
def matmul_transposed(a, b):
    """Product A B^T."""
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = b
    return matmul(a, (b00, b10, b20, b01, b11, b21, b02, b12, b22))


@inline
def left_cauchy_green(f):
    """Symmetric b = F F^T."""
    f00, f01, f02, f10, f11, f12, f20, f21, f22 = f
    return (
        f00 * f00 + f01 * f01 + f02 * f02,
        f00 * f10 + f01 * f11 + f02 * f12,
        f00 * f20 + f01 * f21 + f02 * f22,
        f10 * f10 + f11 * f11 + f12 * f12,
        f10 * f20 + f11 * f21 + f12 * f22,
        f20 * f20 + f21 * f21 + f22 * f22,
    )


@inline
def _jacobi_rotation(app, aqq, apq, arp, arq, p0, p1, p2, q0, q1, q2):
    """Rotate in the p-q plane so that a_pq vanishes; p0.. and q0.. are eigenvector columns p and q."""
    h = aqq - app
    g = apq + apq
    size = absolute(h) + _f(1e-15)
    length, inverse = root_and_inverse(size * size + g * g)
    c, inverse_cosine = root_and_inverse(_f(0.5) + _f(0.5) * (size * inverse))
    s = _f(0.5) * (g * inverse) * inverse_cosine
    shift = _f(0.5) * (length - size)
    negative = h < _f(0)
    s = where(negative, -s, s)
    shift = where(negative, -shift, shift)
    return (
        app - shift,
        aqq + shift,
        c * arp - s * arq,
        s * arp + c * arq,
        c * p0 - s * q0,
        c * p1 - s * q1,
        c * p2 - s * q2,
        s * p0 + c * q0,
        s * p1 + c * q1,
        s * p2 + c * q2,
    )


@inline
def symmetric_eigen(a, sweeps):
    """Eigenvalues (3, unsorted) and eigenvectors (9, columns, det = +1) of a symmetric matrix.

    Cyclic Jacobi with exact rotations; at most ``sweeps`` sweeps (4 reach float32 accuracy), fewer as soon as all
    lanes are diagonal to 1e-6 of their largest numbers, or to 1e-9; what is left then is smaller than that, and it
    enters eigenvalues squared.
    """
    a00, a01, a02, a11, a12, a22 = a
    zero = like(a00, _f(0))
    one = like(a00, _f(1))
    u00, u01, u02, u10, u11, u12, u20, u21, u22 = one, zero, zero, zero, one, zero, zero, zero, one
    tolerance = _f(1e-6) * (absolute(a00) + absolute(a11) + absolute(a22)) + _f(1e-9)
    for _ in range(sweeps):
        if not any_lane(absolute(a01) + absolute(a02) + absolute(a12) > tolerance):
            break
        a00, a11, a02, a12, u00, u10, u20, u01, u11, u21 = _jacobi_rotation(
            a00, a11, a01, a02, a12, u00, u10, u20, u01, u11, u21
        )
        a00, a22, a01, a12, u00, u10, u20, u02, u12, u22 = _jacobi_rotation(
            a00, a22, a02, zero, a12, u00, u10, u20, u02, u12, u22
        )
        a11, a22, a01, a02, u01, u11, u21, u02, u12, u22 = _jacobi_rotation(
            a11, a22, a12, a01, zero, u01, u11, u21, u02, u12, u22
        )
        a12 = zero
    return (a00, a11, a22), (u00, u01, u02, u10, u11, u12, u20, u21, u22)


@inline
def symmetric_from_eigen(values, vectors):
    """U diag(values) U^T as six lanes."""
    s0, s1, s2 = values
    u00, u01, u02, u10, u11, u12, u20, u21, u22 = vectors
    a0, a1, a2 = u00 * s0, u01 * s1, u02 * s2
    b0, b1, b2 = u10 * s0, u11 * s1, u12 * s2
    c0, c1, c2 = u20 * s0, u21 * s1, u22 * s2
    return (
        a0 * u00 + a1 * u01 + a2 * u02,
        a0 * u10 + a1 * u11 + a2 * u12,
        a0 * u20 + a1 * u21 + a2 * u22,
        b0 * u10 + b1 * u11 + b2 * u12,
        b0 * u20 + b1 * u21 + b2 * u22,
        c0 * u20 + c1 * u21 + c2 * u22,
    )


@inline
def _put_larger_first(p, q, v, w):
    """Order two eigenvalues downwards with their vectors; a swap flips one vector, so the basis stays proper."""
    swap = q > p
    v0, v1, v2 = v
    w0, w1, w2 = w
    return (
        where(swap, q, p),
        where(swap, p, q),
        (where(swap, w0, v0), where(swap, w1, v1), where(swap, w2, v2)),
        (where(swap, -v0, w0), where(swap, -v1, w1), where(swap, -v2, w2)),
    )


@inline
def _unit(a, fallback):
    """A vector over its length; ``fallback`` where it is shorter than 1e-18."""
    x, y, z = a
    fx, fy, fz = fallback
    square = x * x + y * y + z * z
    inverse = _f(1) / sqrt(maximum(square, like(square, _f(1e-36))))
    short = square < _f(1e-36)
    return where(short, fx, x * inverse), where(short, fy, y * inverse), where(short, fz, z * inverse)


@inline
def _apply(f, v):
    f00, f01, f02, f10, f11, f12, f20, f21, f22 = f
    v0, v1, v2 = v
    return f00 * v0 + f01 * v1 + f02 * v2, f10 * v0 + f11 * v1 + f12 * v2, f20 * v0 + f21 * v1 + f22 * v2


@inline
def singular_value_decomposition(f):
    """F = U diag(s) V^T with proper rotations U, V (9 lanes each) and s0 >= s1 >= |s2|; s2 < 0 where det F < 0.

    V from the eigenvectors of F^T F; U by orthogonalising F V, its last column as a cross product. So U and V are
    rotations for every F, also flat or turned inside out (a rank of one leaves U's second column arbitrary).
    """
    f00, f01, f02, f10, f11, f12, f20, f21, f22 = f
    values, vectors = symmetric_eigen(left_cauchy_green((f00, f10, f20, f01, f11, f21, f02, f12, f22)), 5)
    p, q, r = values
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = vectors
    p, q, a, b = _put_larger_first(p, q, (a0, a1, a2), (b0, b1, b2))
    p, r, a, c = _put_larger_first(p, r, a, (c0, c1, c2))
    q, r, b, c = _put_larger_first(q, r, b, c)
    fa0, fa1, fa2 = _apply(f, a)
    fb = _apply(f, b)
    fc = _apply(f, c)
    u0, u1, u2 = _unit((fa0, fa1, fa2), a)
    along = u0 * fb[0] + u1 * fb[1] + u2 * fb[2]
    # any direction across u serves as fallback: cross it with the axis that it least follows
    follows_x = absolute(u0) > _f(0.7)
    zero = like(u0, _f(0))
    across = (where(follows_x, u2, zero), where(follows_x, zero, -u2), where(follows_x, -u0, u1))
    w0, w1, w2 = _unit((fb[0] - along * u0, fb[1] - along * u1, fb[2] - along * u2), _unit(across, across))
    t0, t1, t2 = u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0
    s = (
        u0 * fa0 + u1 * fa1 + u2 * fa2,
        w0 * fb[0] + w1 * fb[1] + w2 * fb[2],
        t0 * fc[0] + t1 * fc[1] + t2 * fc[2],
    )
    return (u0, w0, t0, u1, w1, t1, u2, w2, t2), s, (a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2])


@inline
def polar_rotation(f):
    """The proper rotation closest to F: R = U V^T."""
    u, _, v = singular_value_decomposition(f)
    return matmul_transposed(u, v)
