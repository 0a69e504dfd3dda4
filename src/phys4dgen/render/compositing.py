"""Front-to-back alpha compositing of screen-space Gaussians, tile by tile.

Paper: Sec. C.1, Eq. of C(x). Reference: Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering",
2023; alpha = min(0.999, o exp(-s)), nothing below 1/255, a row of pixels ends when its transmittance is <= 1e-4.
(gsplat drops the Gaussian that would carry a pixel below 1e-4; here it is still blended, then the row ends.)

What makes it fast: a row of a tile is 16 pixels, one flat accumulator is indexed with unsigned integers, so that LLVM
turns the inner loop into one vector per row with no branch; and exp is a polynomial.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phys4dgen.render.projection import (
    ALPHA_MIN,
    R_BLUE,
    R_GREEN,
    R_HALF_HEIGHT,
    R_OPACITY,
    R_PAYLOAD,
    R_RED,
    R_X,
    R_XX,
    R_XY,
    R_Y,
    R_YY,
    TILE_PX,
)

__all__ = ["composite_expected", "composite_median"]

_ALPHA_MAX = np.float32(0.999)
_STOP_TRANSMITTANCE = np.float32(1e-4)
_CHECK_EVERY = 32  # Gaussians between two looks at which rows are finished
_HALF = np.float32(0.5)
_ZERO = np.float32(0)
_ONE = np.float32(1)

# exp(8u) = p(u)^8. p is the minimax polynomial of degree 4 for the relative error of exp on [-0.7, 0]: 2.7e-6, hence
# 2.2e-5 after the three squarings. exp(-5.6) < 1/255, so that nothing below the interval is ever drawn.
_U_MIN = np.float32(-0.7)
_E0 = np.float32(0.9999972787381787)
_E1 = np.float32(0.9998246892712612)
_E2 = np.float32(0.49810510559095256)
_E3 = np.float32(0.1592383702815154)
_E4 = np.float32(0.029212485935626576)

_PLANE = TILE_PX * TILE_PX
# Planes of the accumulator: transmittance, red, green, blue, depth or payload.
_PLANES = 5


def _make_composite(median: bool):
    """The compositing kernel for one meaning of depth; the choice is fixed at compile time as it is in the hot loop."""

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp", "reassoc"})
    def composite(part, parts, records, tile_lists, tile_starts, first, end, background, empty, rgb, alpha, depth):
        """Composite every ``parts``-th tile of [first, end), from first + part on.

        Args:
            part: first tile to do, counted from ``first``.
            parts: stride.
            records: [N, RECORD_SIZE] float32 of ``project_gaussians``.
            tile_lists: [pairs] int32, front to back per tile, slot 0 being tile_starts[first].
            tile_starts: [tiles + 1] int64.
            first: first tile of the band.
            end: one past its last tile.
            background: [3] float32.
            empty: depth or payload of pixels that have none.
            rgb: out, [H, W, 3] float32.
            alpha: out, [H, W] float32.
            depth: out, [H, W] float32.
        """
        height, width = alpha.shape
        tile_columns = (width + TILE_PX - 1) // TILE_PX
        red_plane, green_plane = np.uint64(_PLANE), np.uint64(2 * _PLANE)
        blue_plane, depth_plane = np.uint64(3 * _PLANE), np.uint64(4 * _PLANE)
        acc = np.empty(_PLANES * _PLANE, np.float32)
        finished = np.empty(TILE_PX, np.bool_)
        base = tile_starts[first]
        for tile in range(first + part, end, parts):
            tile_row = tile // tile_columns
            y0 = tile_row * TILE_PX
            x0 = (tile - tile_row * tile_columns) * TILE_PX
            acc[:_PLANE] = _ONE
            acc[_PLANE : 4 * _PLANE] = _ZERO
            acc[4 * _PLANE :] = empty
            finished[:] = False
            row_first, row_last = 0, min(TILE_PX, height - y0) - 1  # rows still open
            x_origin, y_origin = np.float32(x0) + _HALF, np.float32(y0) + _HALF
            k = tile_starts[tile] - base
            k_end = tile_starts[tile + 1] - base
            while k < k_end and row_first <= row_last:
                k_check = min(k_end, k + _CHECK_EVERY)
                for slot in range(k, k_check):
                    g = np.uint64(tile_lists[np.uint64(slot)])
                    mean_x, mean_y = records[g, R_X] - x_origin, records[g, R_Y] - y_origin
                    half_height = records[g, R_HALF_HEIGHT]
                    y_from = max(mean_y - half_height, np.float32(row_first))
                    y_to = min(mean_y + half_height, np.float32(row_last))
                    xx, xy, yy = records[g, R_XX], records[g, R_XY], records[g, R_YY]
                    opacity = records[g, R_OPACITY]
                    red, green, blue = records[g, R_RED], records[g, R_GREEN], records[g, R_BLUE]
                    payload = records[g, R_PAYLOAD]
                    for y in range(math.ceil(y_from), math.floor(y_to) + 1):
                        if finished[np.uint64(y)]:
                            continue
                        dy = np.float32(y) - mean_y
                        u_constant = yy * dy * dy
                        u_linear = xy * dy
                        row = np.uint64(y * TILE_PX)
                        for x in range(TILE_PX):
                            q = row + np.uint64(x)
                            dx = np.float32(x) - mean_x
                            u = (xx * dx + u_linear) * dx + u_constant
                            u = max(min(u, _ZERO), _U_MIN)
                            e = _E0 + u * (_E1 + u * (_E2 + u * (_E3 + u * _E4)))
                            e = e * e
                            e = e * e
                            e = e * e
                            a = min(opacity * e, _ALPHA_MAX)
                            a = a if a >= ALPHA_MIN else _ZERO
                            transmittance = acc[q]
                            weight = transmittance * a
                            acc[q + red_plane] += weight * red
                            acc[q + green_plane] += weight * green
                            acc[q + blue_plane] += weight * blue
                            remaining = transmittance - weight
                            if median:
                                before = acc[q + depth_plane]
                                crossed = (transmittance > _HALF) & (remaining <= _HALF)
                                acc[q + depth_plane] = payload if crossed else before
                            else:
                                acc[q + depth_plane] += weight * payload
                            acc[q] = remaining
                k = k_check
                if k < k_end:
                    open_first, open_last = TILE_PX, -1
                    for y in range(row_first, row_last + 1):
                        if finished[y]:
                            continue
                        brightest = _ZERO
                        for x in range(TILE_PX):
                            brightest = max(brightest, acc[np.uint64(y * TILE_PX + x)])
                        if brightest <= _STOP_TRANSMITTANCE:
                            finished[y] = True
                        else:
                            open_first, open_last = min(open_first, y), y
                    row_first, row_last = open_first, open_last
            for y in range(min(TILE_PX, height - y0)):
                for x in range(min(TILE_PX, width - x0)):
                    q = np.uint64(y * TILE_PX + x)
                    transmittance = acc[q]
                    rgb[y0 + y, x0 + x, 0] = acc[q + red_plane] + transmittance * background[0]
                    rgb[y0 + y, x0 + x, 1] = acc[q + green_plane] + transmittance * background[1]
                    rgb[y0 + y, x0 + x, 2] = acc[q + blue_plane] + transmittance * background[2]
                    a = _ONE - transmittance
                    alpha[y0 + y, x0 + x] = a
                    value = acc[q + depth_plane]
                    if not median:
                        value = value / a if a > _ZERO else empty
                    depth[y0 + y, x0 + x] = value

    return composite


composite_median = _make_composite(median=True)
composite_expected = _make_composite(median=False)
