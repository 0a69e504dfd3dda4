"""The picture as it might look under light from everywhere: what shading does to a body's colours is taken out.

A picture carries its light: a pot is pale on the side of the window and dark on the other. To see that both are one
material, the part of the colour that follows the direction of the surface is fitted and removed, in CIELAB. Shading of
a matt body is a polynomial of the second degree in its normal (Ramamoorthi and Hanrahan, "An Efficient Representation
for Irradiance Environment Maps", SIGGRAPH 2001). One such function of the lightness is shared by the whole object;
each colour segment adds one of its own, as far as it has the pixels to support it. Only differences within a segment
are fitted, so that a material's colour stays what it is.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.mask_geometry import depth_inside, slopes
from phys4dgen.types.color import lab_to_srgb, srgb_to_lab

__all__ = ["evenly_lit"]

_RIM_REL = 0.012
"""Nearer to the outline than this share of the picture's side the normal is not to be trusted."""
_SHARED_PRIOR = 0.01
"""Weight, per pixel of the object, of 'there is no shading'."""
_OWN_PRIOR = 0.002
"""The same of 'a segment has no shading of its own'."""
_TEXTURE = 4.0
"""Distance in Lab beyond which a pixel's residual counts as texture: its weight falls with it."""
_STEPS = 12
_MOST_PIXELS = 40_000


def evenly_lit(
    rgb: NDArray[np.float32], mask: NDArray[np.bool_], *, height: NDArray[np.float64], segments: NDArray[np.int64]
) -> NDArray[np.float32]:
    """The colours of a picture without its shading, shape [S, S, 3]; outside the mask as they were.

    Args:
        rgb: straight sRGB in [0, 1], shape [S, S, 3].
        mask: the object, shape [S, S].
        height: of the body's front over the plane of the outline, px, shape [S, S].
        segments: number of the colour segment of each pixel from 1, 0 outside the mask; shape [S, S].
    """
    size = len(mask)
    terms = _shading_terms(_normals(nd.gaussian_filter(height, size / 120)))
    lab = srgb_to_lab(rgb)
    smooth = np.asarray(nd.gaussian_filter(lab, (size / 250, size / 250, 0)))
    trusted = np.flatnonzero(mask & (depth_inside(mask) > _RIM_REL * size))
    if len(trusted) == 0:
        return rgb
    sample = trusted[:: max(1, len(trusted) // _MOST_PIXELS)]
    where, colors, number = terms.reshape(-1, terms.shape[-1])[sample], smooth.reshape(-1, 3)[sample], segments.ravel()
    numbers, group = np.unique(number[sample], return_inverse=True)
    shared = np.zeros((where.shape[1], 3))
    shared[:, :1] = _fitted(where, colors[:, :1], group, prior=_SHARED_PRIOR * len(sample))
    shading = terms @ shared
    shading -= np.median(shading[mask], 0)
    rest = colors - where @ shared
    for k, segment in enumerate(numbers):
        mine = group == k
        own = _fitted(where[mine], rest[mine], np.zeros(int(mine.sum()), np.int64), prior=_OWN_PRIOR * len(sample))
        here = segments == segment
        added = terms[here] @ own
        shading[here] += added - np.median(added, 0)
    return np.where(mask[..., None], lab_to_srgb(lab - shading), rgb).astype(np.float32)


def _normals(height: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of a surface (x right, y up, z towards the camera), shape [S, S, 3]."""
    dx, dy = slopes(height)
    normals = np.stack([-dx, dy, np.ones_like(dx)], -1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _shading_terms(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spherical harmonics of the first and second degree up to factors, shape [.., 8]."""
    x, y, z = np.moveaxis(normals, -1, 0)
    return np.stack([x, y, z, x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1], -1)


def _fitted(
    terms: NDArray[np.float64], values: NDArray[np.float64], group: NDArray[np.int64], *, prior: float
) -> NDArray[np.float64]:
    """Coefficients [K, C] of the terms that explain how values differ within their groups.

    By iteratively reweighted least squares with Huber's weights, since texture is no shading.

    Args:
        terms: shape [M, K].
        values: shape [M, C].
        group: number of the group from 0 that each row belongs to, shape [M].
        prior: weight of coefficients near 0.
    """
    weight = np.ones(len(values))
    found = np.zeros((terms.shape[1], values.shape[1]))
    for _ in range(_STEPS):
        inner_terms = terms - _group_means(terms, weight, group)
        inner_values = values - _group_means(values, weight, group)
        weighted = inner_terms * weight[:, None]
        normal = weighted.T @ inner_terms + prior * np.eye(terms.shape[1])
        found = np.asarray(np.linalg.solve(normal, weighted.T @ inner_values), np.float64)
        residual = np.linalg.norm(inner_values - inner_terms @ found, axis=1)
        weight = 1 / np.maximum(residual / _TEXTURE, 1)
    return found


def _group_means(
    values: NDArray[np.float64], weight: NDArray[np.float64], group: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The weighted mean of each row's group, shape of ``values``."""
    total = np.bincount(group, weight)
    means = [np.bincount(group, weight * column) / total for column in values.T]
    return np.asarray(np.stack(means, 1)[group], np.float64)
