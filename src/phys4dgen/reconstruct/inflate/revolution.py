"""Which rows of an outline look like a body of revolution about a vertical axis: pots, buns, bottles, cacti."""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.silhouette import Silhouette, horizontal_runs
from phys4dgen.types.color import srgb_to_lab

__all__ = ["revolve_evidence", "smoothstep"]

WINDOW_REL = 0.06
"""Rows above and below that are judged together, share of the object's height."""
LIGHTNESS_WEIGHT = 0.25
"""Light falls from one side on round things, so lightness says little."""


def revolve_evidence(outline: Silhouette, rgb: NDArray[np.float32]) -> NDArray[np.float64]:
    """1 for rows of a body of revolution, 0 for others, shape [S, 1].

    Either the whole object is mirror symmetric and coloured in rows, or the rows around are: one run each, about one
    axis, of one colour from rim to rim.
    """
    whole = _whole_object(outline.mask, rgb)
    return np.maximum(whole, _rows(outline, rgb))[:, None]


def smoothstep(x: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """0 below ``low``, 1 above ``high``, a smooth cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _whole_object(mask: NDArray[np.bool_], rgb: NDArray[np.float32]) -> float:
    weight = mask.astype(float)
    row_mean = (rgb * weight[..., None]).sum(1) / np.maximum(weight.sum(1), 1)[:, None]
    residual = float(((rgb - row_mean[:, None])[mask] ** 2).sum())
    total = float(((rgb[mask] - rgb[mask].mean(0)) ** 2).sum())
    row_share = 1 - residual / max(total, 1e-9) if total > 1e-3 * mask.sum() else 1.0
    single = float(weight.sum(1)[horizontal_runs(mask).count == 1].sum() / weight.sum())
    parts = (_mirror_iou(mask), 0.84, 0.92), (row_share, 0.2, 0.4), (single, 0.75, 0.9)
    return float(np.prod([smoothstep(np.array(value), low, high) for value, low, high in parts]))


def _rows(outline: Silhouette, rgb: NDArray[np.float32]) -> NDArray[np.float64]:
    """Evidence of each row from its neighbourhood, shape [S]."""
    mask = outline.mask
    runs = horizontal_runs(mask)
    count = mask.sum(1)
    filled = count > 0
    sigma = max(1.5, WINDOW_REL * outline.height / 2)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        weight = nd.gaussian_filter1d(filled.astype(float), sigma)
        return nd.gaussian_filter1d(np.where(filled, values, 0), sigma) / np.maximum(weight, 1e-6)

    half_width = np.maximum(count / 2, 1)
    axis = np.where(filled, runs.centre.sum(1) / np.maximum(count, 1), 0)
    drift = np.sqrt(np.maximum(mean(axis**2) - mean(axis) ** 2, 0)) / np.maximum(mean(half_width), 1)
    lab = srgb_to_lab(rgb) * [LIGHTNESS_WEIGHT, 1, 1]
    weight = mask[..., None].astype(float)
    row_mean = (lab * weight).sum(1) / np.maximum(count, 1)[:, None]
    spread = np.sqrt((((lab - row_mean[:, None]) ** 2) * weight).sum((1, 2)) / np.maximum(count, 1))
    single = mean((runs.count == 1).astype(float))
    slope = mean(np.abs(np.gradient(half_width)))  # arms and leaves change the width fast, walls do not
    evidence = smoothstep(single, 0.8, 0.97) * smoothstep(-drift, -0.06, -0.025)
    evidence = evidence * smoothstep(-mean(spread), -24, -14) * smoothstep(-slope, -0.7, -0.3)
    return np.where(filled, nd.gaussian_filter1d(evidence, 0.5 * sigma), 0)


def _mirror_iou(mask: NDArray[np.bool_]) -> float:
    """Overlap of the mask with its mirror image about the best vertical axis."""
    rows, columns = np.nonzero(mask)
    size, count = mask.shape[1], len(columns)
    middle = int(2 * np.median(columns))
    best = 0.0
    for twice_axis in range(middle - size // 10, middle + size // 10 + 1):
        mirrored = twice_axis - columns
        valid = (mirrored >= 0) & (mirrored < size)
        shared = int(mask[rows[valid], mirrored[valid]].sum())
        best = max(best, shared / (2 * count - shared))
    return best
