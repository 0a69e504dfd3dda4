"""The outline of the object on the working grid: rows, base, distance to the rim.

Lengths are working pixels (px), rows count downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.mask_geometry import depth_inside

__all__ = ["Runs", "Silhouette", "horizontal_runs", "silhouette"]

_FOOT = 0.04
"""The foot is this lowest share of the height."""
_SIDES = (0.08, 0.16)
"""Between these shares of the height above the lowest row the sides of a body that stands go straight down."""
_STEEPEST = 0.3
"""Sine of the highest elevation; what curves more is round below."""
_STEEPEST_SIDES = 0.8
"""Change of the width per row above which the sides are those of something round below, such as a ball."""
_FIT = 0.06
"""Largest mean error of the widths about half an ellipse, relative to the width, for a base to be seen as round."""
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
        base_row: row of a flat base in the plane of the outline, or None where the object does not stand on one.
        tilt: tangent of the camera's elevation, read from the curve of the base; the base is at
            ``base_row + tilt * z`` for a height z towards the camera.
        long_mask: the mask with its foot prolonged downwards, shape [S + extra, S]: the shape of which the object is
            the part above ``base_row``.
        rim_distance: signed distance to the outline, positive inside, to a fraction of a pixel from the opacity;
            the base is not part of the outline. Shape [S, S].
    """

    mask: NDArray[np.bool_]
    base_row: int | None
    tilt: float
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
    base_row, tilt = _base(mask)
    if base_row is None:
        return Silhouette(mask, None, 0.0, mask, _signed_distance(alpha, mask))
    long_mask = _prolonged(mask, base_row)
    # Corners that the curved lower edge of a base leaves out belong to the prolonged shape, but not to the object.
    prolonged = long_mask.copy()
    prolonged[: base_row + 1] = mask[: base_row + 1]
    opaque = np.zeros((len(prolonged), size), np.float32)
    opaque[:size] = alpha
    opaque[base_row + 1 :] = 0
    opaque[base_row + 1 :][prolonged[base_row + 1 :]] = 1
    opaque[base_row - 1 : base_row + 1][mask[base_row - 1 : base_row + 1] & prolonged[base_row + 1]] = 1
    return Silhouette(mask, base_row, tilt, long_mask, _signed_distance(opaque, prolonged)[:size])


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


def _base(mask: NDArray[np.bool_]) -> tuple[int | None, float]:
    """Row and tilt of the base of an object that stands; (None, 0) for others.

    Seen from above, a round base shows its front rim as half an ellipse below the corners of the outline: its height
    over its half width is the sine of the camera's elevation. A body that is round below narrows over a taller part.
    """
    rows = np.flatnonzero(mask.any(1))
    bottom, height = int(rows[-1]), int(rows[-1] - rows[0] + 1)
    width = mask.sum(1)
    if width[bottom - max(1, int(_FOOT * height))] < _STANDS * width.max():
        return None, 0.0
    sagitta = _base_sagitta(mask, width, bottom, height)
    sine = 2 * sagitta / max(float(width[bottom - sagitta]), 1.0)
    return bottom - sagitta, sine / math.sqrt(1 - sine**2)


def _base_sagitta(mask: NDArray[np.bool_], width: NDArray[np.int64], bottom: int, height: int) -> int:
    """Rows by which the front of a round base hangs below its corners, by a fit to the widths; 0 for other bases."""
    sides = np.arange(int(_SIDES[0] * height), max(int(_SIDES[1] * height), int(_SIDES[0] * height) + 3))
    if bottom - sides[-1] < 0 or (horizontal_runs(mask[bottom - sides[-1] : bottom - 1]).count != 1).any():
        return 0
    slope, intercept = np.polyfit(sides + 0.5, width[bottom - sides], 1)
    above = np.arange(sides[0]) + 0.5
    if abs(slope) > _STEEPEST_SIDES:
        return 0
    straight = intercept + slope * above
    candidates = np.arange(min(int(_STEEPEST * width[bottom - sides[0]] / 2), sides[0]) + 1)
    dip = np.clip(1 - above / np.maximum(candidates, 0.5)[:, None], 0, 1)
    error = np.abs(straight * np.sqrt(1 - dip**2) - width[bottom - np.arange(sides[0])]).mean(1)
    best = int(np.argmin(error))
    return int(candidates[best]) if error[best] < _FIT * max(intercept, 1.0) else 0


def _prolonged(mask: NDArray[np.bool_], base_row: int) -> NDArray[np.bool_]:
    """The mask with its foot prolonged by half its height.

    It gives the base the full depth of the shape above; without it every pot is an egg.
    """
    rows = np.flatnonzero(mask.any(1))
    height = int(rows[-1] - rows[0] + 1)
    foot_top = max(base_row - max(1, int(_FOOT * height)), int(rows[0]))
    length = max(len(mask), base_row + 1 + height // 2)
    long_mask = np.pad(mask, ((0, length - len(mask)), (0, 0)))
    long_mask[base_row + 1 :] = False
    long_mask[foot_top : base_row + 1 + height // 2] |= mask[foot_top]
    return long_mask


def _signed_distance(alpha: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance to the outline, positive inside; near it from the opacity, which knows fractions of a pixel."""
    padded = np.pad(mask, 1, mode="edge")  # an object cut off by the picture has no rim there
    inside = depth_inside(padded)[1:-1, 1:-1]
    outside = depth_inside(~mask)
    distance = np.where(mask, inside - 0.5, 0.5 - outside)
    fine = np.clip(2 * (nd.gaussian_filter(alpha, 0.6) - 0.5), -1.5, 1.5)
    return np.where(np.abs(distance) < 1.6, 0.6 * fine + 0.4 * distance, distance)
