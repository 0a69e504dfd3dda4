"""Real spherical harmonics of degree 0 to 3 in the order and sign of 3D Gaussian splatting.

Reference: Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2(2), 2013; the coefficient order is the one of
INRIA's 3DGS and gsplat: k = l^2 + l + m, with the Condon-Shortley sign.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["fill_sh_basis"]

# sqrt of rational multiples of 1/pi; the letters are l and |m|.
_C00 = np.float32(0.28209479177387814)
_C1 = np.float32(0.4886025119029199)
_C2 = np.float32(1.0925484305920792)
_C20 = np.float32(0.31539156525252005)
_C22 = np.float32(0.5462742152960396)
_C33 = np.float32(0.5900435899266435)
_C32 = np.float32(2.890611442640554)
_C31 = np.float32(0.4570457994644658)
_C30 = np.float32(0.3731763325901154)
_C32_EVEN = np.float32(1.445305721320277)
_TWO = np.float32(2)
_THREE = np.float32(3)
_FOUR = np.float32(4)


@njit(inline="always")
def fill_sh_basis(basis, degree, x, y, z):
    """Write the (degree + 1)^2 basis functions of the unit direction (x, y, z) into ``basis`` (float32, length 16)."""
    basis[0] = _C00
    if degree > 0:
        basis[1] = -_C1 * y
        basis[2] = _C1 * z
        basis[3] = -_C1 * x
    if degree > 1:
        xx = x * x
        yy = y * y
        zz = z * z
        basis[4] = _C2 * x * y
        basis[5] = -_C2 * y * z
        basis[6] = _C20 * (_TWO * zz - xx - yy)
        basis[7] = -_C2 * x * z
        basis[8] = _C22 * (xx - yy)
        if degree > 2:
            basis[9] = -_C33 * y * (_THREE * xx - yy)
            basis[10] = _C32 * x * y * z
            basis[11] = -_C31 * y * (_FOUR * zz - xx - yy)
            basis[12] = _C30 * z * (_TWO * zz - _THREE * xx - _THREE * yy)
            basis[13] = -_C31 * x * (_FOUR * zz - xx - yy)
            basis[14] = _C32_EVEN * z * (xx - yy)
            basis[15] = -_C33 * x * (xx - _THREE * yy)
