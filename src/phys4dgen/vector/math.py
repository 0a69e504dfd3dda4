"""Logarithm and exponential on lanes, for use inside ``numba.njit``; all are inlined into their caller."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from phys4dgen.vector.lanes import as_float_bits, as_int_bits, floor, like, maximum, minimum, to_float, to_int, where

__all__ = ["exp", "expm1", "inline", "log", "log1p"]

_OPTIONS: dict[str, Any] = {
    "forceinline": True,
    "fastmath": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,  # only kernels call them
    "no_cfunc_wrapper": True,
}
inline: Any = njit(**_OPTIONS)
"""Decorator of helper functions that are inlined into the kernel that calls them."""

_f = np.float32


@inline
def _log_of_one_plus(r):
    """ln(1 + r) for 1 + r in [sqrt(1/2), sqrt(2)] (polynomial of Cephes ``logf``)."""
    p = _f(7.0376836292e-2) * r - _f(1.1514610310e-1)
    p = p * r + _f(1.1676998740e-1)
    p = p * r - _f(1.2420140846e-1)
    p = p * r + _f(1.4249322787e-1)
    p = p * r - _f(1.6668057665e-1)
    p = p * r + _f(2.0000714765e-1)
    p = p * r - _f(2.4999993993e-1)
    p = p * r + _f(3.3333331174e-1)
    return (p * r - _f(0.5)) * (r * r) + r


@inline
def log(x):
    """Natural logarithm of positive lanes; relative error about 1e-7."""
    bits = as_int_bits(x)
    exponent = (bits - 0x3F3504F3) >> 23  # x = 2^exponent (1 + r), 1 + r in [sqrt(1/2), sqrt(2)]
    r = as_float_bits(bits - (exponent << 23)) - _f(1)
    return to_float(exponent) * _f(0.6931471806) + _log_of_one_plus(r)


@inline
def log1p(x):
    """ln(1 + x) of lanes above -1; relative error about 1e-7, for the smallest x too."""
    bits = as_int_bits(x + _f(1))
    exponent = (bits - 0x3F3504F3) >> 23
    r = as_float_bits(bits - (exponent << 23)) - _f(1)
    r = where((exponent >= 0) & (exponent <= 0), x, r)  # x itself has the digits that 1 + x lost
    return to_float(exponent) * _f(0.6931471806) + _log_of_one_plus(r)


@inline
def _reduced_exponential(x):
    """(2^n, q) with e^x = 2^n (1 + q); x limited to +-80."""
    x = maximum(minimum(x, like(x, _f(80))), like(x, _f(-80)))
    n = floor(x * _f(1.44269504) + _f(0.5))
    # ln 2 in two parts, so that r keeps its digits for large n
    r = (x - n * _f(0.693359375)) + n * _f(2.12194440e-4)
    p = _f(1.9875691500e-4) * r + _f(1.3981999507e-3)
    p = p * r + _f(8.3334519073e-3)
    p = p * r + _f(4.1665795894e-2)
    p = p * r + _f(1.6666665459e-1)
    p = p * r + _f(5.0000001201e-1)
    return as_float_bits((to_int(n) + 127) << 23), p * (r * r) + r


@inline
def exp(x):
    """Exponential; relative error about 1e-7 for small x, arguments limited to +-80 (Cephes ``expf``)."""
    scale, q = _reduced_exponential(x)
    return (q + _f(1)) * scale


@inline
def expm1(x):
    """e^x - 1; relative error about 2e-7, for the smallest x too; arguments limited to +-80."""
    scale, q = _reduced_exponential(x)
    return q * scale + (scale - _f(1))
