"""Foreground without weights: what differs from the colour of the picture's border.

The background is modelled as a smooth field, a quadratic polynomial of the position in each channel of CIELAB, fitted
robustly to the border. What lies within a threshold of the model and is joined to the border is background; so is what
is joined to it through a soft shadow: darker, of the same colour, without a sharp edge. It works for studio pictures
only, and says so where it would fail.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.reconstruct.mask_geometry import pieces, slopes
from phys4dgen.types.color import srgb_to_lab

__all__ = ["BorderCut", "cut_by_border_color"]

WORKING_SIDE_PX = 512
LIGHTNESS_WEIGHT = 0.6
"""Weight of a difference in lightness against one in colour."""
MAX_BORDER_SPREAD = 8.0
"""Largest distance (Lab) of nine in ten border pixels from the fitted background; beyond it the border is not plain."""
SHADOW_DEPTH = 40.0
"""A cast shadow is at most this much darker (L) than the background."""
SHADOW_CHROMA = 7.0
"""A cast shadow differs at most this much in a, b from the background."""
SHADOW_SLOPE = 4.0
"""A soft shadow changes by at most this much L per pixel of the working picture."""
_BORDER_REL = 0.03
_LEAST_THRESHOLD = 7.0


@dataclass(frozen=True, eq=False)
class BorderCut:
    """What the border says.

    Attributes:
        alpha: opacity of the object, shape [H, W], float32.
        problem: why the cut is not to be trusted, one clause; empty if nothing speaks against it.
    """

    alpha: NDArray[np.float32]
    problem: str


def cut_by_border_color(rgb: NDArray[np.float32]) -> BorderCut:
    """Separate an object from a plain background.

    Args:
        rgb: sRGB in [0, 1], shape [H, W, 3].
    """
    height, width = rgb.shape[:2]
    scale = min(1.0, WORKING_SIDE_PX / max(height, width))
    size = (max(16, round(width * scale)), max(16, round(height * scale)))
    eight_bit = Image.fromarray(np.rint(rgb * 255).astype(np.uint8))
    lab = srgb_to_lab(np.asarray(eight_bit.resize(size, Image.Resampling.BOX)) / 255)
    rows, columns = _without_bars(lab)
    inner = lab[rows, columns]
    background, border_spread = _fitted_background(inner)
    weight = np.array([LIGHTNESS_WEIGHT, 1.0, 1.0])
    distance = np.linalg.norm((inner - background) * weight, axis=-1)
    threshold = max(_LEAST_THRESHOLD, 2 * border_spread)
    object_mask = np.zeros(lab.shape[:2], bool)
    object_mask[rows, columns] = _object(distance, threshold, shadow=_soft_shadow(inner, background))
    soft = nd.gaussian_filter(object_mask.astype(np.float32), 0.7)
    alpha = np.asarray(Image.fromarray(soft).resize((width, height), Image.Resampling.BICUBIC), np.float32)
    inside = object_mask[rows, columns]
    return BorderCut(np.clip(alpha, 0, 1).astype(np.float32), _problem(inside, border_spread))


def _without_bars(lab: NDArray[np.float64]) -> tuple[slice, slice]:
    """The picture inside bars of one colour (a letterbox), as slices of rows and columns."""

    def inner(lines: NDArray[np.float64]) -> slice:
        flat = lines.reshape(len(lines), -1, 3)
        plain = np.abs(flat - flat[:, :1]).max((1, 2)) < 1.0
        first, last = 0, len(lines)
        while first < len(lines) // 3 and plain[first] and np.abs(flat[first] - flat[0]).max() < 1.0:
            first += 1
        while last > 2 * len(lines) // 3 and plain[last - 1] and np.abs(flat[last - 1] - flat[-1]).max() < 1.0:
            last -= 1
        # A bar ends with a jump; a background of one colour does not.
        jump_before = first and np.abs(np.median(flat[first + 1], 0) - flat[0, 0]).max() > 10
        jump_after = last < len(lines) and np.abs(np.median(flat[last - 2], 0) - flat[-1, 0]).max() > 10
        return slice(first + 2 if jump_before else 0, last - 2 if jump_after else len(lines))

    return inner(lab), inner(np.swapaxes(lab, 0, 1))


def _fitted_background(lab: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The background everywhere, shape [H, W, 3], and how far 90 % of the border lie from it (weighted Lab)."""
    height, width = lab.shape[:2]
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
    band = max(2, round(_BORDER_REL * max(height, width)))
    border = np.ones((height, width), bool)
    border[band:-band, band:-band] = False
    weight = np.array([LIGHTNESS_WEIGHT, 1.0, 1.0])
    design, values = terms[border], lab[border]
    kept = np.ones(len(design), bool)
    fit = np.zeros((6, 3))
    error = np.zeros(len(design))
    for _ in range(5):
        fit = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        error = np.linalg.norm((values - design @ fit) * weight, axis=1)
        kept = error <= max(2.5 * float(np.median(error[kept])), 1.0)
    return terms @ fit, float(np.percentile(error, 90))


def _soft_shadow(lab: NDArray[np.float64], background: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Pixels that look like the background in a soft shadow; a and b fall with the lightness there."""
    smooth = np.asarray(nd.gaussian_filter(lab, (1, 1, 0)))
    darkening = smooth[..., 0] - background[..., 0]
    slope = np.hypot(*slopes(darkening))
    shaded = background[..., 1:] * (smooth[..., :1] / np.maximum(background[..., :1], 1))
    chroma = np.linalg.norm(smooth[..., 1:] - shaded, axis=-1)
    darker = (darkening < 0) & (darkening > -SHADOW_DEPTH)
    return darker & (chroma < SHADOW_CHROMA) & (nd.maximum_filter(slope, 3) < SHADOW_SLOPE)


def _object(distance: NDArray[np.float64], threshold: float, *, shadow: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels far from the background or cut off from the border by such; slivers and crumbs removed."""
    far = nd.gaussian_filter(distance, 0.8) > threshold
    far = _closed(far)
    labels, sizes = pieces(~far)
    edge = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    background = np.isin(labels, edge[edge > 0])
    # A hole that shows the background well and is not tiny is a hole (a handle, a ring).
    for index in 1 + np.flatnonzero(sizes > 1e-3 * distance.size):
        hole = labels == index
        if np.median(distance[hole]) < 0.5 * threshold:
            background |= hole
    background = _grown(background, background | shadow)
    solid = np.asarray(nd.binary_opening(~background, iterations=2), bool)
    labels, sizes = pieces(solid)
    if len(sizes) > 1:
        solid = np.isin(labels, 1 + np.flatnonzero(sizes >= 0.02 * sizes.max()))
    # Opening has rounded thin parts off: take back what is joined to the rest.
    near = np.asarray(nd.binary_dilation(solid, iterations=6), bool)
    return _grown(solid, near & ~background)


def _closed(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(nd.binary_closing(np.pad(mask, 4), iterations=2), bool)[4:-4, 4:-4]


def _grown(mask: NDArray[np.bool_], limit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The pixels of ``limit`` that are joined to ``mask``."""
    return np.asarray(nd.binary_propagation(mask, mask=limit), bool)


def _problem(mask: NDArray[np.bool_], border_spread: float) -> str:
    share = float(mask.mean())
    rim = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    if border_spread > MAX_BORDER_SPREAD:
        return "the border of the picture is not of one plain colour"
    if share < 0.005:
        return "nothing stands out from the colour of the border"
    if share > 0.9 or float(rim.mean()) > 0.25:
        return "the object cannot be told from the colour of the border"
    return ""
