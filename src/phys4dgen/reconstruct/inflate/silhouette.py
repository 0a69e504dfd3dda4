"""The outline of the object on the working grid: rows, base, distance to the rim.

Lengths are working pixels (px), rows count downwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

__all__ = ["Runs", "Silhouette", "horizontal_runs", "silhouette"]

_FOOT = 0.04
"""The foot is this lowest share of the height."""
_STANDS = 0.25
"""An object whose foot is at least this wide, relative to its widest row, stands on a flat base."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Horizontal runs of a mask.

    Attributes:
        centre: middle column of the run that each pixel is in, 0 outside, shape [H, W].
        half_width: half the length of that run, 0 outside, shape [H, W].
        count: number of runs in each row, shape [H].
    """

    centre: NDArray[np.float64]
    half_width: NDArray[np.float64]
    count: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The outline of an object of size [S, S].

    Attributes:
        mask: the object, shape [S, S].
        base_row: last row of a flat base, or None where the object does not stand on one.
        long_mask: the mask with its foot prolonged downwards, shape [S + extra, S]: the shape of which the object is
            the part above ``base_row``.
        rim_distance: signed distance to the outline, positive inside, to a fraction of a pixel from the opacity;
            the base is not part of the outline. Shape [S, S].
    """

    mask: NDArray[np.bool_]
    base_row: int | None
    long_mask: NDArray[np.bool_]
    rim_distance: NDArray[np.float64]

    @property
    def height(self) -> int:
        """Rows of the object."""
        rows = np.flatnonzero(self.mask.any(1))
        return int(rows[-1] - rows[0] + 1)

    @property
    def bottom_row(self) -> int:
        """Last row of the object."""
        return int(np.flatnonzero(self.mask.any(1))[-1])


def silhouette(alpha: NDArray[np.float32]) -> Silhouette:
    """The outline of a framed picture.

    Args:
        alpha: opacity, shape [S, S].
    """
    mask = alpha > 0.5
    size = mask.shape[0]
    base_row, long_mask = _prolonged(mask)
    if base_row is None:
        return Silhouette(mask, None, mask, _signed_distance(alpha, mask))
    # Corners that the curved lower edge of a base leaves out belong to the prolonged shape, but not to the object.
    prolonged = long_mask.copy()
    prolonged[: base_row + 1] = mask[: base_row + 1]
    opaque = np.zeros((len(prolonged), size), np.float32)
    opaque[:size] = alpha
    opaque[base_row + 1 :] = 0
    opaque[base_row + 1 :][prolonged[base_row + 1 :]] = 1
    opaque[base_row - 1 : base_row + 1][mask[base_row - 1 : base_row + 1] & prolonged[base_row + 1]] = 1
    return Silhouette(mask, base_row, long_mask, _signed_distance(opaque, prolonged)[:size])


def horizontal_runs(mask: NDArray[np.bool_]) -> Runs:
    """The runs of every row of a mask."""
    height, width = mask.shape
    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, starts = np.nonzero(steps == 1)
    ends = np.nonzero(steps == -1)[1]
    index = np.cumsum(steps[:, :width].ravel() == 1).reshape(height, width) - 1
    centre = np.zeros((height, width))
    half_width = np.zeros((height, width))
    centre[mask] = ((starts + ends - 1) / 2)[index[mask]]
    half_width[mask] = ((ends - starts) / 2)[index[mask]]
    return Runs(centre, half_width, np.bincount(rows, minlength=height))


def _prolonged(mask: NDArray[np.bool_]) -> tuple[int | None, NDArray[np.bool_]]:
    """Base row and prolonged mask of an object that stands; (None, mask) for others.

    Prolonging by half the height gives the base the full depth of the shape above; without it every pot is an egg.
    """
    rows = np.flatnonzero(mask.any(1))
    bottom, height = int(rows[-1]), int(rows[-1] - rows[0] + 1)
    foot_top = bottom - max(1, int(_FOOT * height))
    foot = mask[foot_top]
    if foot.sum() < _STANDS * mask.sum(1).max():
        return None, mask
    long_mask = np.pad(mask, ((0, max(height // 2, foot_top + height // 2 - len(mask))), (0, 0)))
    long_mask[foot_top:] |= foot
    return bottom, long_mask[: bottom + 1 + height // 2]


def _signed_distance(alpha: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance to the outline, positive inside; near it from the opacity, which knows fractions of a pixel."""
    padded = np.pad(mask, 1, mode="edge")  # an object cut off by the picture has no rim there
    inside = np.asarray(nd.distance_transform_edt(padded))[1:-1, 1:-1]
    outside = np.asarray(nd.distance_transform_edt(~mask)) if mask.any() else np.zeros(mask.shape)
    distance = np.where(mask, inside - 0.5, 0.5 - outside)
    fine = np.clip(2 * (nd.gaussian_filter(alpha, 0.6) - 0.5), -1.5, 1.5)
    return np.where(np.abs(distance) < 1.6, 0.6 * fine + 0.4 * distance, distance)
