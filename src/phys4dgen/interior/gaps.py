"""Surfaces that the grid cannot tell apart.

Two free slabs keep nothing of their relative velocity at a gap of one grid cell and all of it from two on (MOTION.md,
result 3): leaves that lie closer move as if they were glued.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.types import SHEET, Continuum, Frame

__all__ = ["welded_share"]

_REACH_CELLS = 2.0
_STEEPNESS = 0.6
"""Another site of the same sheet lies beside this one; one of another sheet lies over or under it: its direction makes
an angle with the sheet whose sine exceeds this."""


def welded_share(continuum: Continuum, *, frame: Frame, free: NDArray[np.bool_], cell_m: float) -> float:
    """Share of the free sheets' sites that have another surface closer than two grid cells.

    Args:
        continuum: particles.
        frame: input coordinates -> metres.
        free: particles that move, [P].
        cell_m: grid cell dx, m.
    """
    chosen = np.flatnonzero((continuum.shape == SHEET) & free)
    if len(chosen) < 2:
        return 0.0
    middle = frame.to_metres(continuum.positions[chosen]) - continuum.offset_m[chosen]
    offset = continuum.offset_m[chosen]
    normal = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-12)
    pairs = KDTree(middle).query_pairs(_REACH_CELLS * cell_m, output_type="ndarray")
    apart = middle[pairs[:, 1]] - middle[pairs[:, 0]]
    length = np.linalg.norm(apart, axis=1)
    rise = np.minimum(np.abs((apart * normal[pairs[:, 0]]).sum(1)), np.abs((apart * normal[pairs[:, 1]]).sum(1)))
    over = (length > 0.5 * cell_m) & (rise > _STEEPNESS * length)
    welded = np.zeros(len(chosen), bool)
    welded[pairs[over].ravel()] = True
    return float(welded.mean())
