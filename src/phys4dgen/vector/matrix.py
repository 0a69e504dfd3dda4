"""3 x 3 matrices on lanes: products, determinants, symmetric eigen-decomposition.

A 3 x 3 matrix is a tuple of nine float lanes, row by row; a symmetric one is six: (00, 01, 02, 11, 12, 22). All
functions are for use inside ``numba.njit`` and are inlined into their caller.
"""

from __future__ import annotations

import numpy as np

from phys4dgen.vector.lanes import absolute, like, maximum, minimum, root_and_inverse, where
from phys4dgen.vector.math import inline

__all__ = [
    "determinant",
    "identity_plus",
    "left_cauchy_green",
    "matmul",
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
def _leading_eigenvalue(half_det):
    """Of a traceless symmetric matrix whose eigenvalues have a sum of squares of 6: the one that is largest in size.

    The root of x^3 - 3 x = 2 |half_det| in [sqrt(3), 2], by one Newton step from a parabola, off by 4e-7 at most; the
    other two are 2.6 or more away from it.
    """
    r = minimum(absolute(half_det), like(half_det, _f(1)))
    x = (_f(-0.05395231) * r + _f(0.32070747)) * r + _f(1.73264765)
    square = x * x
    x = _f(2) * (x * square + r) / (_f(3) * square - _f(3))
    return where(half_det < _f(0), -x, x)


@inline
def _null_vector(a):
    """Unit vector that a symmetric matrix of rank two takes to zero: the longest column of the adjugate."""
    a00, a01, a02, a11, a12, a22 = a
    m00, m01, m02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    m11, m12, m22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    second = m11 > m00
    x, y, z = where(second, m01, m00), where(second, m11, m01), where(second, m12, m02)
    third = m22 > maximum(m00, m11)
    x, y, z = where(third, m02, x), where(third, m12, y), where(third, m22, z)
    _, inverse = root_and_inverse(x * x + y * y + z * z)
    return x * inverse, y * inverse, z * inverse


@inline
def _across(v):
    """Two unit vectors across a unit vector v and each other; the three in the order (first, second, v) are proper."""
    x, y, z = v
    one = like(z, _f(1))
    sign = where(z < _f(0), -one, one)
    a = -one / (sign + z)
    b = x * y * a
    return (one + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@inline
def _form(a, v, w):
    """v^T A w of a symmetric matrix."""
    a00, a01, a02, a11, a12, a22 = a
    v0, v1, v2 = v
    w0, w1, w2 = w
    return (
        v0 * (a00 * w0 + a01 * w1 + a02 * w2)
        + v1 * (a01 * w0 + a11 * w1 + a12 * w2)
        + v2 * (a02 * w0 + a12 * w1 + a22 * w2)
    )


@inline
def symmetric_eigen(a):
    """Eigenvalues (3, unsorted) and eigenvectors (9, columns, det = +1) of a symmetric matrix.

    In closed form: the eigenvalue that lies farthest from the mean, which is never close to another one, its vector,
    and in the plane across that one exact rotation. So vectors are orthonormal, and U diag U^T is A, to float32
    accuracy whatever eigenvalues agree; differences of numbers below 1e-18 are not resolved.

    Sources: O. K. Smith, *Eigenvalues of a symmetric 3 x 3 matrix*, Commun. ACM 4 (1961) 168; D. Eberly, *A robust
    eigensolver for 3 x 3 symmetric matrices*, Geometric Tools 2014 (order of the steps); T. Duff et al., *Building an
    orthonormal basis, revisited*, JCGT 6 (2017).
    """
    a00, a01, a02, a11, a12, a22 = a
    mean = (a00 + a11 + a22) * _f(1 / 3)
    d0, d1, d2 = a00 - mean, a11 - mean, a22 - mean
    square = (d0 * d0 + d1 * d1 + d2 * d2 + _f(2) * (a01 * a01 + a02 * a02 + a12 * a12)) * _f(1 / 6)
    size, inverse = root_and_inverse(maximum(square, like(square, _f(1e-36))))
    b00, b01, b02, b11, b12, b22 = (
        inverse * d0, inverse * a01, inverse * a02, inverse * d1, inverse * a12, inverse * d2,
    )  # fmt: skip
    half_det = _f(0.5) * (b00 * (b11 * b22 - b12 * b12) + b01 * (b02 * b12 - b01 * b22) + b02 * (b01 * b12 - b02 * b11))
    x = _leading_eigenvalue(half_det)
    v = _null_vector((b00 - x, b01, b02, b11 - x, b12, b22 - x))
    p, q = _across(v)
    b = (b00, b01, b02, b11, b12, b22)
    app, apq, aqq = _form(b, p, p), _form(b, p, q), _form(b, q, q)
    h = aqq - app
    g = apq + apq
    opening = absolute(h) + _f(1e-15)
    length, inverse = root_and_inverse(opening * opening + g * g)
    c, inverse_cosine = root_and_inverse(_f(0.5) + _f(0.5) * (opening * inverse))
    s = _f(0.5) * (g * inverse) * inverse_cosine
    shift = _f(0.5) * (length - opening)
    negative = h < _f(0)
    s = where(negative, -s, s)
    shift = where(negative, -shift, shift)
    p0, p1, p2 = p
    q0, q1, q2 = q
    return (
        mean + size * (app - shift),
        mean + size * (aqq + shift),
        mean - size * (app + aqq),
    ), (
        c * p0 - s * q0, s * p0 + c * q0, v[0],
        c * p1 - s * q1, s * p1 + c * q1, v[1],
        c * p2 - s * q2, s * p2 + c * q2, v[2],
    )  # fmt: skip


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
