"""A colour for every surface point: the picture in front, the picture wrapped round at the sides and on the back."""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.back_colors import back_colors, extended
from phys4dgen.reconstruct.inflate.revolution import smoothstep
from phys4dgen.reconstruct.inflate.silhouette import Silhouette
from phys4dgen.reconstruct.inflate.surface import Kind, SurfacePoints, at
from phys4dgen.reconstruct.inflate.thickness import Thickness
from phys4dgen.reconstruct.mask_geometry import nearest_inside

__all__ = ["painted"]

SIDE_COSINE = 0.42
"""Where the surface is steeper than this against the line of sight, its pixels are smears."""
BASE_SHADE = 0.6
"""Brightness of the underside relative to the foot."""


def painted(
    points: SurfacePoints, rgb: NDArray[np.float32], *, outline: Silhouette, body: Thickness
) -> NDArray[np.float64]:
    """Colours of surface points in [0, 1], shape [M, 3].

    Args:
        points: on the surface.
        rgb: the picture without its fringe, shape [S, S, 3].
        outline: of the object.
        body: its thickness, which says how the picture wraps round.
    """
    mask, size = outline.mask, len(outline.mask)
    front = extended(rgb, mask)
    back = back_colors(rgb, mask)
    source = _wrapped(outline, body)
    sigma = size / 70
    weight = nd.gaussian_filter(mask.astype(float), sigma)
    low = np.asarray(nd.gaussian_filter(rgb * mask[..., None].astype(float), (sigma, sigma, 0)))
    low = extended((low / np.maximum(weight, 1e-3)[..., None]).astype(np.float32), mask)

    position = points.position
    around = np.stack([at(source[0], position), at(source[1], position)], 1)
    colors = at(back, around)
    seen = points.kind <= Kind.STEEP
    straight = at(front, position[seen])
    side = smoothstep(SIDE_COSINE - points.normal[seen, 2], 0, 0.35)[:, None]
    smear_free = at(low, position[seen]) + 0.9 * (at(back, around[seen]) - at(low, around[seen]))
    colors[seen] = (1 - side) * straight + side * smear_free
    base = points.kind == Kind.BASE
    if base.any():
        foot = position[base].copy()
        foot[:, 1] = (outline.base_row or outline.bottom_row) - 0.04 * outline.height
        near = at(low, foot)
        colors[base] = BASE_SHADE * (0.5 * near + 0.5 * np.median(near, 0))
    return np.clip(colors, 0, 1)


def _wrapped(outline: Silhouette, body: Thickness) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Column and row of the picture that each pixel of the back shows.

    Distances along the surface are kept, not along the picture: an orthographic mirror would smear the rim over the
    sides. On a ball of radius R the pixel at distance r from its centre lies R asin(r / R) along the surface.
    """
    size = len(outline.mask)
    y, x = np.mgrid[:size, :size].astype(float)
    balls, runs = body.balls, body.runs
    dx, dy = x - balls.centre_x, y - balls.centre_y
    stretch = _equidistant(np.hypot(dx, dy) / balls.radius)
    row_dx = x - runs.centre
    row_stretch = _equidistant(np.abs(row_dx) / np.maximum(runs.half_width, 0.5))
    share = body.revolve
    source_x = (1 - share) * (balls.centre_x + dx * stretch) + share * (runs.centre + row_dx * row_stretch)
    source_y = (1 - share) * (balls.centre_y + dy * stretch) + share * y
    nearest = nearest_inside(outline.mask)
    shift_x, shift_y = (
        np.asarray(nd.gaussian_filter(np.where(outline.mask, shift, 0)[nearest], size / 200))
        for shift in (source_x - x, source_y - y)
    )
    last = size - 1 if outline.base_row is None else outline.base_row
    return x + shift_x, np.minimum(y + shift_y, last)


def _equidistant(relative: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2 / pi) asin(q) / q for q = distance / radius."""
    q = np.clip(relative, 1e-3, 1)
    return 2 / np.pi * np.arcsin(q) / q
