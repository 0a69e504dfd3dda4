"""Colour parts of a picture by merging of pixels.

Felzenszwalb and Huttenlocher, "Efficient Graph-Based Image Segmentation", IJCV 2004: two components merge along an
edge that is no stronger than the strongest edge inside either of them plus a tolerance that falls with its size.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numba import njit
from numpy.typing import NDArray

from phys4dgen.types.color import srgb_to_lab

__all__ = ["color_segments"]

_SCALE = 118.0
"""Tolerance of a component, Lab units times pixels."""


def color_segments(rgb: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the segment of each pixel from 1, 0 outside the mask; shape [H, W].

    Args:
        rgb: sRGB in [0, 1], shape [H, W, 3].
        mask: the object, shape [H, W].
    """
    size = rgb.shape[0]
    lab = srgb_to_lab(rgb)
    lab = np.stack([nd.gaussian_filter(lab[..., c], max(0.8, size / 300)) for c in range(3)], -1)
    index = np.arange(mask.size).reshape(mask.shape)
    first, second, weight = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, mask.shape[0] - dy), slice(max(0, -dx), mask.shape[1] - max(0, dx)))
        there = (slice(dy, None), slice(max(0, dx), mask.shape[1] - max(0, -dx)))
        both = mask[here] & mask[there]
        first.append(index[here][both])
        second.append(index[there][both])
        weight.append(np.linalg.norm(lab[here] - lab[there], axis=-1)[both])
    strength = np.concatenate(weight)
    order = np.argsort(strength, kind="stable")
    root = _merge(
        np.concatenate(first)[order],
        np.concatenate(second)[order],
        strength[order],
        mask.size,
        _SCALE,
        max(20, int(mask.sum()) // 250),
    )
    labels = np.zeros(mask.shape, np.int64)
    labels[mask] = np.unique(root.reshape(mask.shape)[mask], return_inverse=True)[1] + 1
    return labels


@njit(cache=True)
def _merge(first, second, weight, count, scale, least_size):  # pyright: ignore
    """Root of each pixel's component; edges come sorted by weight."""
    parent = np.arange(count)
    size = np.ones(count, np.int64)
    limit = np.full(count, scale)
    for sweep in range(2):
        for e in range(first.shape[0]):
            a, b = first[e], second[e]
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a == b:
                continue
            joins = weight[e] <= min(limit[a], limit[b]) if sweep == 0 else min(size[a], size[b]) < least_size
            if joins:
                parent[b] = a
                size[a] += size[b]
                limit[a] = weight[e] + scale / size[a]
    for p in range(count):
        q = p
        while parent[q] != q:
            q = parent[q]
        parent[p] = q
    return parent
