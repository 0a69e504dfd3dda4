"""How thick the object is behind each pixel: h^2 in front of and behind the plane of the outline.

Two bodies are blended: the union of inscribed balls, right for limbs and blobs, and a body of revolution about a
vertical axis, right for pots, buns and bottles. On top comes a relief of the colour parts. Lengths are working pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.balls import Balls, inscribed_balls
from phys4dgen.reconstruct.inflate.revolution import revolve_evidence
from phys4dgen.reconstruct.inflate.silhouette import Runs, Silhouette, horizontal_runs
from phys4dgen.reconstruct.mask_geometry import depth_inside, nearest_inside

__all__ = ["Thickness", "relief", "thickness"]

LEAST_REVOLVE = 0.35
"""Share of the body of revolution in every object: rounder heads, hats that are no blades."""
FLATTEST_BOWL = 1.5
"""A row is at most this many times as deep as its typical vertical half run: a brim does not become a disc."""
SMOOTHING_REL = 0.012
"""Standard deviation of the smoothing, share of the picture's side."""
EDGE_SMOOTHING = 0.4
"""The same for a body of revolution, relative."""
RELIEF_GAIN = 0.35
RELIEF_REACH_REL = 0.035
"""Parts bulge within this distance of their border, share of the picture's side."""


@dataclass(frozen=True, eq=False)
class Thickness:
    """The undisturbed body; all arrays of shape [S, S].

    Attributes:
        height: depth of the front (and of the back) from the plane of the outline, px.
        balls: the inscribed ball of each pixel.
        runs: the row of each pixel.
        revolve: share of the body of revolution in each row, shape [S, 1].
        offset: squared distance of each pixel from the middle of its ball and row, blended, px^2.
    """

    height: NDArray[np.float64]
    balls: Balls
    runs: Runs
    revolve: NDArray[np.float64]
    offset: NDArray[np.float64]


def thickness(outline: Silhouette, rgb: NDArray[np.float32], *, gain: float = 1.0) -> Thickness:
    """The body behind an outline.

    Args:
        outline: of the object.
        rgb: its colours, shape [S, S, 3].
        gain: depth relative to what is found.
    """
    mask, long_mask = outline.mask, outline.long_mask
    size = mask.shape[0]
    sigma = SMOOTHING_REL * size
    balls = inscribed_balls(long_mask)
    runs = horizontal_runs(long_mask)
    revolve = np.maximum(LEAST_REVOLVE, revolve_evidence(outline, rgb))
    share = np.pad(revolve, ((0, len(long_mask) - size), (0, 0)), mode="edge")
    revolved, along = _revolved(outline, runs, sigma)
    body = (1 - share) * balls.height_squared + share * revolved
    # Balls meet in creases; a body of revolution has none, but edges that should stay.
    smooth = (1 - share) * _smoothed(body, long_mask, balls.radius, sigma)
    smooth += share * _smoothed(body, long_mask, balls.radius, EDGE_SMOOTHING * sigma)
    height = np.sqrt(np.where(mask, smooth[:size] * gain**2, 0))
    crop = Balls(balls.height_squared[:size], balls.centre_y[:size], balls.centre_x[:size], balls.radius[:size])
    rows = Runs(runs.centre[:size], runs.half_width[:size], runs.count[:size])
    y, x = np.mgrid[:size, :size]
    offset = (1 - revolve) * ((x - crop.centre_x) ** 2 + (y - crop.centre_y) ** 2) + revolve * along[:size] ** 2
    return Thickness(height, crop, rows, revolve, np.where(mask, offset, 0.0))


def relief(segments: NDArray[np.int64], mask: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the colour parts take from the front and from the back (negative), px, each of shape [S, S].

    Each part bulges by a quarter circle from its border with others, which leaves grooves between them. The back shows
    the parts that reach the rim only, since the others are marks on the front.
    """
    size = segments.shape[0]
    reach = RELIEF_REACH_REL * size
    border = np.zeros(segments.shape, bool)
    border[:, 1:] |= (segments[:, 1:] != segments[:, :-1]) & mask[:, 1:] & mask[:, :-1]
    border[1:] |= (segments[1:] != segments[:-1]) & mask[1:] & mask[:-1]
    depth = np.minimum(depth_inside(~border), reach) if border.any() else np.full(mask.shape, reach)
    bulge = RELIEF_GAIN * np.sqrt(2 * reach * depth - depth**2)
    rim_band = mask & (depth_inside(mask) < 2.5)
    wraps = np.isin(segments, np.unique(segments[rim_band]))
    groove = np.where(mask, bulge - RELIEF_GAIN * reach, 0)
    front, back = groove, np.where(wraps, groove, 0)
    return nd.gaussian_filter(front, 1.2), nd.gaussian_filter(back, 1.5)


def _revolved(outline: Silhouette, runs: Runs, sigma: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """h^2 of the body of revolution, and the distance of each pixel from the middle of its row; [H, W]."""
    mask, long_mask = outline.mask, outline.long_mask
    vertical = horizontal_runs(np.ascontiguousarray(mask.T)).half_width.T
    typical = np.zeros(long_mask.shape)
    for y in np.flatnonzero(mask.any(1)):
        ends = np.flatnonzero(np.diff(mask[y].astype(np.int8), prepend=0, append=0))
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            typical[y, first:last] = np.median(vertical[y, first:last])
    if outline.base_row is not None:
        typical[outline.base_row :] = typical[max(outline.base_row - 3, 0)]
        gaps = typical == 0
        typical[gaps] = np.broadcast_to(typical.max(1, keepdims=True), typical.shape)[gaps]
    depth = np.where(long_mask, np.minimum(runs.half_width, FLATTEST_BOWL * np.maximum(typical, 1)), 0)
    weight = nd.gaussian_filter(long_mask.astype(float), (sigma, 0))
    depth = nd.gaussian_filter(depth, (sigma, 0)) / np.maximum(weight, 1e-6)
    along = np.where(long_mask, np.arange(mask.shape[1]) - runs.centre, 0)
    across = np.clip(np.abs(along) / np.maximum(runs.half_width, 0.5), 0, 1)
    return np.where(long_mask, depth**2 * (1 - across**2), 0), along


def _smoothed(
    body: NDArray[np.float64], mask: NDArray[np.bool_], radius: NDArray[np.float64], sigma: float
) -> NDArray[np.float64]:
    """h^2 without creases; the outside falls off like the inside rises, so that the rim stays where it is."""
    slope = np.minimum(2 * np.maximum(radius[nearest_inside(mask)], 2), 6.0)
    signed = np.where(mask, body, -slope * depth_inside(~mask))
    smooth = nd.gaussian_filter(signed, sigma)
    rim = np.maximum(depth_inside(mask) - 0.5, 0)
    return np.where(mask, np.maximum(smooth, 0.02 * rim), 0)
