"""Surfaces that the grid cannot tell apart.

Two free slabs keep nothing of their relative velocity at a gap of one grid cell and all of it from two on (MOTION.md,
result 3): leaves that lie closer move as if they were glued. Bodies with velocity fields of their own do not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.types import SHEET, Continuum, Frame

__all__ = ["Gaps", "narrow_gaps"]

_REACH_CELLS = 2.0
_STEEPNESS = 0.6
"""Another site of the same sheet lies beside this one; one of another sheet lies over or under it: its direction makes
an angle with the sheet whose sine exceeds this."""


class Gaps(NamedTuple):
    """Shares of the free sheets' sites.

    Attributes:
        close: that have another surface closer than two grid cells.
        welded: that have one closer in their own velocity field, so that both move as one.
        welded_parts: that have such a one which is of another part.
    """

    close: float
    welded: float
    welded_parts: float


def narrow_gaps(
    continuum: Continuum, *, frame: Frame, free: NDArray[np.bool_], body_id: NDArray[np.int32], cell_m: float
) -> Gaps:
    """How much of the thin surfaces lies too close to another one.

    Args:
        continuum: particles.
        frame: input coordinates -> metres.
        free: particles that move, [P].
        body_id: body of each particle; different ones have different velocity fields, [P].
        cell_m: grid cell dx, m.
    """
    chosen = np.flatnonzero((continuum.shape == SHEET) & free)
    if len(chosen) < 2:
        return Gaps(0.0, 0.0, 0.0)
    middle = frame.to_metres(continuum.positions[chosen]) - continuum.offset_m[chosen]
    offset = continuum.offset_m[chosen]
    normal = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-12)
    pairs = KDTree(middle).query_pairs(_REACH_CELLS * cell_m, output_type="ndarray")
    apart = middle[pairs[:, 1]] - middle[pairs[:, 0]]
    length = np.linalg.norm(apart, axis=1)
    rise = np.minimum(np.abs((apart * normal[pairs[:, 0]]).sum(1)), np.abs((apart * normal[pairs[:, 1]]).sum(1)))
    over = pairs[(length > 0.5 * cell_m) & (rise > _STEEPNESS * length)]
    glued = over[np.equal(*body_id[chosen][over].T)]
    of_two = glued[np.not_equal(*continuum.part[chosen][glued].T)]
    site = continuum.site[chosen]
    return Gaps(*(len(np.unique(site[some])) / len(np.unique(site)) for some in (over, glued, of_two)))
