"""EWA projection of 3D Gaussians to screen-space Gaussians, one pass per frame.

Paper: Sec. C.1. References: Zwicker et al., "EWA Splatting", 2002; gsplat 1.5.3 (``fully_fused_projection``), whose
rules are kept: pixel centres at +0.5, 0.3 px^2 added to the screen-space covariance, the Jacobian evaluated inside a
frustum widened by 15 % on either side, contributions below 1/255 dropped.

The arithmetic up to the 2D covariance is float64. A Gaussian close to the camera, or a needle, has a covariance whose
determinant is lost in float32; the double arithmetic costs little because this pass is bound by memory.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phys4dgen.render.spherical_harmonics import fill_sh_basis

__all__ = [
    "ALPHA_MIN",
    "CULLED",
    "RECORD_SIZE",
    "TILE_PX",
    "project_gaussians",
]

TILE_PX = 16
"""Side of a tile in pixels: one row of a tile is one 512-bit vector of float32."""

RECORD_SIZE = 12
"""float32 values per projected Gaussian: what compositing reads, in the order of the R_* indices below."""

R_X, R_Y, R_XX, R_XY, R_YY, R_OPACITY, R_RED, R_GREEN, R_BLUE, R_PAYLOAD, R_HALF_HEIGHT = range(11)

CULLED = np.uint32(0xFFFFFFFF)
"""Sort key of a Gaussian that does not reach the picture."""

ALPHA_MIN = np.float32(1 / 255)
_EPS2D_PX2 = 0.3
_FRUSTUM_MARGIN = 0.15
_EXP_ARGUMENT_SCALE = 0.125
_HUGE = np.float32(3e38)
_ZERO = np.float32(0)
_HALF = np.float32(0.5)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def project_gaussians(
    part,
    parts,
    means,
    covariances,
    opacities,
    colors,
    sh_degree,
    sh_rotations,
    payloads,
    viewmat,
    K,
    width,
    height,
    near,
    antialiased,
    records,
    sort_keys,
    tile_rects,
):
    """Project the Gaussians of slice ``part`` of ``parts`` and write their record, sort key and tile rectangle.

    Args:
        part: which of the ``parts`` equal slices of the Gaussians to do.
        parts: number of slices.
        means: [N, 3] float32.
        covariances: xx, xy, xz, yy, yz, zz; [N, 6] float32.
        opacities: [N] float32.
        colors: [N, K, 3] float32: SH coefficients, or RGB with K = 1 when ``sh_degree`` is -1.
        sh_degree: 0 to 3, or -1.
        sh_rotations: [N, 3, 3] float32 rotations R; SH is evaluated at R^T d. Length 0: none.
        payloads: [N] float32 that compositing picks at the median; length 0: the depth.
        viewmat: [4, 4] float64.
        K: [3, 3] float64.
        width: pixels.
        height: pixels.
        near: nearest depth drawn, input units.
        antialiased: scale opacities by sqrt(det / det with the 0.3 px^2).
        records: out, [N, RECORD_SIZE] float32. The conic is stored as -1/16 of the inverse covariance, so that the
            quadratic form directly gives one eighth of the exponent (compositing.py).
        sort_keys: out, [N] uint32: the bits of the depth, or CULLED.
        tile_rects: out, [N, 4] int16: first and last tile column, first and last tile row, inclusive.
    """
    n = means.shape[0]
    r00, r01, r02, t0 = viewmat[0, 0], viewmat[0, 1], viewmat[0, 2], viewmat[0, 3]
    r10, r11, r12, t1 = viewmat[1, 0], viewmat[1, 1], viewmat[1, 2], viewmat[1, 3]
    r20, r21, r22, t2 = viewmat[2, 0], viewmat[2, 1], viewmat[2, 2], viewmat[2, 3]
    eye_x = -(r00 * t0 + r10 * t1 + r20 * t2)
    eye_y = -(r01 * t0 + r11 * t1 + r21 * t2)
    eye_z = -(r02 * t0 + r12 * t1 + r22 * t2)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    ux_min = -(cx + _FRUSTUM_MARGIN * width) / fx
    ux_max = (width - cx + _FRUSTUM_MARGIN * width) / fx
    uy_min = -(cy + _FRUSTUM_MARGIN * height) / fy
    uy_max = (height - cy + _FRUSTUM_MARGIN * height) / fy
    # Outermost pixel centres.
    x_last = np.float32(width - 0.5)
    y_last = np.float32(height - 0.5)
    basis = np.zeros(16, np.float32)
    coefficient_count = (sh_degree + 1) * (sh_degree + 1)

    for i in range(n * part // parts, n * (part + 1) // parts):
        sort_keys[i] = CULLED
        x, y, z = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
        depth = r20 * x + r21 * y + r22 * z + t2
        opacity = opacities[i]
        # Every test is written so that NaN fails it.
        if not (depth > near and depth < _HUGE and opacity >= ALPHA_MIN):
            continue
        inverse_depth = 1 / depth
        ux = (r00 * x + r01 * y + r02 * z + t0) * inverse_depth
        uy = (r10 * x + r11 * y + r12 * z + t1) * inverse_depth
        mean_x = np.float32(fx * ux + cx)
        mean_y = np.float32(fy * uy + cy)

        # Rows a and b of J R, J at the clamped direction.
        ux = min(max(ux, ux_min), ux_max)
        uy = min(max(uy, uy_min), uy_max)
        fx_z = fx * inverse_depth
        fy_z = fy * inverse_depth
        a0, a1, a2 = fx_z * (r00 - ux * r20), fx_z * (r01 - ux * r21), fx_z * (r02 - ux * r22)
        b0, b1, b2 = fy_z * (r10 - uy * r20), fy_z * (r11 - uy * r21), fy_z * (r12 - uy * r22)
        sxx, sxy, sxz = np.float64(covariances[i, 0]), np.float64(covariances[i, 1]), np.float64(covariances[i, 2])
        syy, syz, szz = np.float64(covariances[i, 3]), np.float64(covariances[i, 4]), np.float64(covariances[i, 5])
        sa0 = sxx * a0 + sxy * a1 + sxz * a2
        sa1 = sxy * a0 + syy * a1 + syz * a2
        sa2 = sxz * a0 + syz * a1 + szz * a2
        sb0 = sxx * b0 + sxy * b1 + sxz * b2
        sb1 = sxy * b0 + syy * b1 + syz * b2
        sb2 = sxz * b0 + syz * b1 + szz * b2
        cov_xx = a0 * sa0 + a1 * sa1 + a2 * sa2
        cov_xy = b0 * sa0 + b1 * sa1 + b2 * sa2
        cov_yy = b0 * sb0 + b1 * sb1 + b2 * sb2
        det_sharp = cov_xx * cov_yy - cov_xy * cov_xy
        cov_xx += _EPS2D_PX2
        cov_yy += _EPS2D_PX2
        det = cov_xx * cov_yy - cov_xy * cov_xy
        # With Sigma positive semi-definite no eigenvalue is below 0.3, hence det >= 0.3 (trace - 0.3). A Sigma that
        # rounding made indefinite is pulled back to that bound, else its conic would be a hyperbola.
        det_min = _EPS2D_PX2 * (cov_xx + cov_yy - _EPS2D_PX2)
        if not (cov_xx >= _EPS2D_PX2 and cov_yy >= _EPS2D_PX2 and det_min < 1e30):
            continue
        if not det >= det_min:
            cov_xy = math.copysign(math.sqrt(max(cov_xx * cov_yy - det_min, 0.0)), cov_xy)
            det = max(cov_xx * cov_yy - cov_xy * cov_xy, det_min)
        if antialiased:
            opacity *= np.float32(math.sqrt(max(det_sharp / det, 0.0)))
            if not opacity >= ALPHA_MIN:
                continue

        # The box where opacity * exp(-s) >= 1/255 (SnugBox: Hanson et al., "Speedy-Splat", 2025).
        reach = np.float32(2) * math.log(opacity / ALPHA_MIN)
        half_width = math.sqrt(reach * np.float32(cov_xx))
        half_height = math.sqrt(reach * np.float32(cov_yy))
        x_from, x_to = mean_x - half_width, mean_x + half_width
        y_from, y_to = mean_y - half_height, mean_y + half_height
        if not (x_to >= _HALF and y_to >= _HALF and x_from <= x_last and y_from <= y_last):
            continue
        column_first = math.ceil(max(x_from, _HALF) - _HALF)
        column_last = math.floor(min(x_to, x_last) - _HALF)
        row_first = math.ceil(max(y_from, _HALF) - _HALF)
        row_last = math.floor(min(y_to, y_last) - _HALF)
        if column_first > column_last or row_first > row_last:
            continue

        if sh_degree < 0:
            red, green, blue = colors[i, 0, 0], colors[i, 0, 1], colors[i, 0, 2]
        else:
            dx, dy, dz = x - eye_x, y - eye_y, z - eye_z
            scale = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx * scale, dy * scale, dz * scale
            if sh_rotations.shape[0] > 0:
                turn = sh_rotations[i]
                dx, dy, dz = (
                    turn[0, 0] * dx + turn[1, 0] * dy + turn[2, 0] * dz,
                    turn[0, 1] * dx + turn[1, 1] * dy + turn[2, 1] * dz,
                    turn[0, 2] * dx + turn[1, 2] * dy + turn[2, 2] * dz,
                )
            fill_sh_basis(basis, sh_degree, np.float32(dx), np.float32(dy), np.float32(dz))
            red = green = blue = _HALF
            for k in range(coefficient_count):
                red += basis[k] * colors[i, k, 0]
                green += basis[k] * colors[i, k, 1]
                blue += basis[k] * colors[i, k, 2]
            red, green, blue = max(red, _ZERO), max(green, _ZERO), max(blue, _ZERO)
        if not abs(red) + abs(green) + abs(blue) < _HUGE:
            continue

        inverse_det = 1 / det
        record = records[i]
        record[R_X] = mean_x
        record[R_Y] = mean_y
        record[R_XX] = np.float32(-0.5 * _EXP_ARGUMENT_SCALE * cov_yy * inverse_det)
        record[R_XY] = np.float32(_EXP_ARGUMENT_SCALE * cov_xy * inverse_det)
        record[R_YY] = np.float32(-0.5 * _EXP_ARGUMENT_SCALE * cov_xx * inverse_det)
        record[R_OPACITY] = opacity
        record[R_RED] = red
        record[R_GREEN] = green
        record[R_BLUE] = blue
        depth_f32 = np.float32(depth)
        record[R_PAYLOAD] = payloads[i] if payloads.shape[0] > 0 else depth_f32
        record[R_HALF_HEIGHT] = half_height
        rect = tile_rects[i]
        rect[0] = column_first // TILE_PX
        rect[1] = column_last // TILE_PX
        rect[2] = row_first // TILE_PX
        rect[3] = row_last // TILE_PX
        sort_keys[i] = depth_f32.view(np.uint32)
