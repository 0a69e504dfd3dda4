"""Root, logarithm and exponential of symmetric 3 x 3 matrices near the identity, without eigenvectors.

Each is a ratio of polynomials (a convergent or Pade approximant of the scalar function) whose powers beyond the second
are replaced by the Cayley-Hamilton theorem, A^3 = I1 A^2 - I2 A + I3, so that it costs one inverse: about half of an
eigen-decomposition and what follows it. All keep the relative digits of small matrices.

A symmetric matrix is six lanes (00, 01, 02, 11, 12, 22). For use inside ``numba.njit``; all are inlined.

Source: N. J. Higham, *Functions of Matrices*, SIAM 2008, ch. 6, 10, 11.
"""

from __future__ import annotations

import numpy as np

from phys4dgen.vector.math import inline

__all__ = ["expm1_near_zero", "half_log1p_near_zero", "powers", "root1p_near_zero", "squared_norm"]

_f = np.float32


@inline
def squared_norm(a):
    """Sum of the squares of all nine numbers."""
    a00, a01, a02, a11, a12, a22 = a
    return a00 * a00 + a11 * a11 + a22 * a22 + _f(2) * (a01 * a01 + a02 * a02 + a12 * a12)


@inline
def powers(a):
    """(A A, invariants): six lanes, and trace, sum of the principal minors and determinant of A."""
    a00, a01, a02, a11, a12, a22 = a
    p00, p01, p02 = a00 * a00, a01 * a01, a02 * a02
    p11, p12, p22 = a11 * a11, a12 * a12, a22 * a22
    m00, m01, m02 = a11 * a22 - p12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    squared = (
        p00 + p01 + p02,
        a01 * (a00 + a11) + a02 * a12,
        a02 * (a00 + a22) + a01 * a12,
        p01 + p11 + p12,
        a12 * (a11 + a22) + a01 * a02,
        p02 + p12 + p22,
    )
    minors = m00 + (a00 * a22 - p02) + (a00 * a11 - p01)
    return squared, (a00 + a11 + a22, minors, a00 * m00 + a01 * m01 + a02 * m02)


@inline
def _polynomial(c, a, squared):
    """c0 I + c1 A + c2 A A."""
    c0, c1, c2 = c
    a00, a01, a02, a11, a12, a22 = a
    b00, b01, b02, b11, b12, b22 = squared
    return (
        c0 + c1 * a00 + c2 * b00,
        c1 * a01 + c2 * b01,
        c1 * a02 + c2 * b02,
        c0 + c1 * a11 + c2 * b11,
        c1 * a12 + c2 * b12,
        c0 + c1 * a22 + c2 * b22,
    )


@inline
def _ratio(above, below, a, squared):
    """The polynomial ``above`` of A times the inverse of the polynomial ``below``; they commute."""
    n00, n01, n02, n11, n12, n22 = _polynomial(above, a, squared)
    d00, d01, d02, d11, d12, d22 = _polynomial(below, a, squared)
    m00, m01, m02 = d11 * d22 - d12 * d12, d02 * d12 - d01 * d22, d01 * d12 - d02 * d11
    m11, m12, m22 = d00 * d22 - d02 * d02, d01 * d02 - d00 * d12, d00 * d11 - d01 * d01
    inverse = _f(1) / (d00 * m00 + d01 * m01 + d02 * m02)
    return (
        inverse * (n00 * m00 + n01 * m01 + n02 * m02),
        inverse * (n00 * m01 + n01 * m11 + n02 * m12),
        inverse * (n00 * m02 + n01 * m12 + n02 * m22),
        inverse * (n01 * m01 + n11 * m11 + n12 * m12),
        inverse * (n01 * m02 + n11 * m12 + n12 * m22),
        inverse * (n02 * m02 + n12 * m12 + n22 * m22),
    )


@inline
def root1p_near_zero(a, squared, invariants):
    """sqrt(I + A) - I; off by 6e-7 of A at most where |A| <= 0.4 (Frobenius). ``squared``, ``invariants``: ``powers``.

    x (64 + 80 x + 24 x^2 + x^3) / (128 + 192 x + 80 x^2 + 8 x^3), a convergent of x / (2 + x / (2 + x / ...)).
    """
    first, second, third = invariants
    above = (
        (_f(24) + first) * third,
        _f(64) - _f(24) * second + third - first * second,
        _f(80) + (_f(24) + first) * first - second,
    )
    below = _f(128) + _f(8) * third, _f(192) - _f(8) * second, _f(80) + _f(8) * first
    return _ratio(above, below, a, squared)


@inline
def half_log1p_near_zero(a, squared, invariants):
    """ln(I + A) / 2; off by 1e-7 of itself at most where |A| <= 0.4 (Frobenius). Arguments as ``root1p_near_zero``.

    x (210 + 315 x + 130 x^2 + 25/2 x^3) / (420 + 840 x + 540 x^2 + 120 x^3 + 6 x^4).
    """
    first, second, third = invariants
    cubed1 = third - first * second  # A^4 = (I1^2 - I2) A^2 + (I3 - I1 I2) A + I1 I3
    cubed2 = first * first - second
    above = (
        (_f(130) + _f(12.5) * first) * third,
        _f(210) - _f(130) * second + _f(12.5) * cubed1,
        _f(315) + _f(130) * first + _f(12.5) * cubed2,
    )
    below = (
        _f(420) + (_f(120) + _f(6) * first) * third,
        _f(840) - _f(120) * second + _f(6) * cubed1,
        _f(540) + _f(120) * first + _f(6) * cubed2,
    )
    return _ratio(above, below, a, squared)


@inline
def expm1_near_zero(a):
    """exp(A) - I; off by 2e-7 of itself at most where |A| <= 0.5 (Frobenius).

    (120 x + 2 x^3) / (120 - 60 x + 12 x^2 - x^3).
    """
    squared, (first, second, third) = powers(a)
    above = _f(2) * third, _f(120) - _f(2) * second, _f(2) * first
    below = _f(120) - third, second - _f(60), _f(12) - first
    return _ratio(above, below, a, squared)
