"""Colours of the side that no picture shows: the front without its marks.

A mark (an eye, a nose, a label) is what is not joined to the rim in colour: morphological reconstruction from the rim
fills every pit and cuts every peak that the rim does not explain (Vincent, "Morphological Grayscale Reconstruction in
Image Analysis", IEEE TIP 1993, here by a priority flood). Few marks are removed and their place is filled from around;
many marks are a texture and stay.
"""

from __future__ import annotations

import heapq

import numpy as np
import scipy.ndimage as nd
from numba import njit
from numpy.typing import NDArray

from phys4dgen.reconstruct.mask_geometry import depth_inside, nearest_inside, pieces
from phys4dgen.types.color import srgb_to_lab

__all__ = ["back_colors", "extended"]

MARK_CONTRAST = 0.10
"""Difference from the reconstruction above which a pixel belongs to a mark."""
MOST_MARKS = 10
"""More marks than this are a texture."""
MINORITY_REACH_REL = 0.04
"""Surroundings of a removed mark, share of the picture's side."""
MINORITY_DISTANCE = 25.0
"""A colour further than this (Lab) from that of most of the surroundings does not fill the hole."""
_LEAST_MARK = 4e-4
"""Smallest mark, share of the object's pixels."""
_RGB_TO_YCBCR = np.array([[0.299, 0.587, 0.114], [-0.169, -0.331, 0.5], [0.5, -0.419, -0.081]])


def back_colors(rgb: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The picture without its marks, extended beyond the mask; shape [S, S, 3].

    Args:
        rgb: colours of the front, shape [S, S, 3].
        mask: the object, shape [S, S].
    """
    size = mask.shape[0]
    low = _blurred(rgb, size / 220)
    near_outer = depth_inside(~_outer_rim(mask))
    rim = mask & (near_outer <= max(3, 0.02 * size))
    ycbcr = low @ _RGB_TO_YCBCR.T
    explained = np.stack([_explained_by_rim(ycbcr[..., c], mask, rim) for c in range(3)], -1)
    difference = np.abs(explained @ np.linalg.inv(_RGB_TO_YCBCR).T - low).max(-1)
    spots = nd.binary_opening(mask & (difference > MARK_CONTRAST))
    labels, sizes = pieces(np.asarray(nd.binary_dilation(spots, iterations=2), bool))
    marks = 1 + np.flatnonzero(sizes > _LEAST_MARK * mask.sum())
    if len(marks) > MOST_MARKS:
        return extended(rgb, mask)
    beside = mask & (near_outer <= max(2, 0.012 * size))
    removed = [mark for mark in marks if not _wraps_round(rgb, labels == mark, beside)]
    hole = np.asarray(nd.binary_dilation(np.isin(labels, removed), iterations=max(2, int(0.01 * size))), bool)
    hole = hole & (depth_inside(mask) >= 2)
    return extended(_filled(rgb, mask, hole), mask)


def extended(rgb: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Colours with those of the nearest pixel of the mask outside it; shape [S, S, 3]."""
    return rgb[nearest_inside(mask)]


def _outer_rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The first and last pixel of every row and the first of every column.

    These go round to the back. The underside and the inside of legs do not, and a picture often shows the ground there.
    """
    rim = np.zeros_like(mask)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    rim[rows, mask[rows].argmax(1)] = True
    rim[rows, mask.shape[1] - 1 - mask[rows, ::-1].argmax(1)] = True
    rim[rows[-max(1, len(rows) // 25) :]] = False
    rim[mask[:, columns].argmax(0), columns] = True
    return rim


def _explained_by_rim(
    values: NDArray[np.float64], mask: NDArray[np.bool_], rim: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Pits filled, then peaks cut, as far as the rim does not lead into them."""
    filled = _flood(np.ascontiguousarray(values), mask, rim)
    return -_flood(np.ascontiguousarray(-filled), mask, rim)


@njit(cache=True)
def _flood(values, mask, seeds):  # pyright: ignore
    """Per pixel the least height from which it can be reached from the seeds, never below its own value."""
    height, width = values.shape
    level = values.copy()
    done = np.zeros((height, width), np.bool_)
    queue = [(values[0, 0], 0, 0)]
    queue.pop()
    for y in range(height):
        for x in range(width):
            if seeds[y, x]:
                done[y, x] = True
                heapq.heappush(queue, (values[y, x], y, x))
    while len(queue) > 0:
        reached, y, x = heapq.heappop(queue)
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                v, u = y + dy, x + dx
                if v < 0 or u < 0 or v >= height or u >= width or done[v, u] or not mask[v, u]:
                    continue
                done[v, u] = True
                level[v, u] = max(values[v, u], reached)
                heapq.heappush(queue, (level[v, u], v, u))
    return level


def _wraps_round(rgb: NDArray[np.float32], mark: NDArray[np.bool_], rim: NDArray[np.bool_]) -> bool:
    """Whether a mark has the colour of the rim beside it: then it is a thing that goes round, not a mark."""
    size = rim.shape[0]
    reach = int(0.07 * size)
    rows, columns = np.nonzero(mark)
    window = (
        slice(max(0, rows.min() - reach), rows.max() + reach + 1),
        slice(max(0, columns.min() - reach), columns.max() + reach + 1),
    )
    near = rim[window] & (depth_inside(~mark[window]) <= reach)
    if near.sum() < 5:
        return False
    color = np.median(rgb[mark], 0)
    return float((np.abs(rgb[window][near] - color).mean(-1) < 0.12).mean()) > 0.25


def _filled(rgb: NDArray[np.float32], mask: NDArray[np.bool_], hole: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The hole filled smoothly from around, with the texture reflected from outside it."""
    if not hole.any():
        return rgb
    size = mask.shape[0]
    known = (mask & ~hole).astype(np.float64)
    base = _push_pull(rgb.astype(np.float64), known * ~_minority_beside(rgb, mask & ~hole, hole))
    base = np.where(hole[..., None], _blurred(base, size / 80), base)
    sigma = size / 110
    weight = np.maximum(nd.gaussian_filter(known, sigma), 1e-3)[..., None]
    texture = np.where(known[..., None] > 0, rgb - _blurred(rgb * known[..., None], sigma) / weight, 0)
    nearest_y, nearest_x = nearest_inside(mask & ~hole)
    y, x = np.mgrid[:size, :size]
    mirror = np.clip(2 * nearest_y - y, 0, size - 1), np.clip(2 * nearest_x - x, 0, size - 1)
    reflected = texture[mirror] * known[mirror][..., None]
    return np.where(hole[..., None], np.clip(base + reflected, 0, 1), rgb).astype(np.float32)


def _minority_beside(rgb: NDArray[np.float32], known: NDArray[np.bool_], hole: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels beside each hole that are not of the colour of most of its surroundings: the rest of what was removed."""
    size = len(hole)
    lab = srgb_to_lab(rgb)
    minority = np.zeros_like(hole)
    labels, sizes = pieces(hole)
    for index in range(1, len(sizes) + 1):
        ring = known & (depth_inside(labels != index) <= MINORITY_REACH_REL * size)
        if ring.any():
            away = np.linalg.norm(lab[ring] - np.median(lab[ring], 0), axis=1)
            minority[ring] |= away > MINORITY_DISTANCE
    return minority


def _push_pull(values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth extension of what has weight 1 into what has weight 0, by a pyramid of weighted means."""
    if min(weight.shape) < 4:
        total = max(float(weight.sum()), 1e-6)
        mean = (values * weight[..., None]).sum((0, 1)) / total
        return np.broadcast_to(mean, values.shape)
    height, width = weight.shape
    pad = ((0, height % 2), (0, width % 2))
    blocks_w = np.pad(weight, pad)
    blocks_v = np.pad(values * weight[..., None], (*pad, (0, 0)))
    quarter = (len(blocks_w) // 2, 2, blocks_w.shape[1] // 2, 2)
    sum_w = blocks_w.reshape(quarter).sum((1, 3))
    mean = blocks_v.reshape(*quarter, 3).sum((1, 3)) / np.maximum(sum_w, 1e-6)[..., None]
    coarse = _push_pull(mean, np.minimum(sum_w, 1))
    fine = np.asarray(nd.zoom(coarse, (2, 2, 1), order=1, mode="nearest", grid_mode=True))
    return values * weight[..., None] + fine[:height, :width] * (1 - weight[..., None])


def _blurred(image: NDArray[np.floating], sigma: float) -> NDArray[np.float64]:
    return np.asarray(nd.gaussian_filter(image.astype(np.float64), (sigma, sigma, 0)))
