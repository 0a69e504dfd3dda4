"""The mean over the thickness of thin parts: what is left of a strain when its bending part is taken away.

The particles of a site of a rod or of a sheet's rim surround its middle. Inside a sheet a particle stands on one face
alone (seed.py), and the other face is that of its neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from phys4dgen.types import SHEET, SOLID, Continuum, Frame

__all__ = ["cross_section_means"]

_OPPOSITE = 4  # neighbours, as on a chequerboard
_REACH_SPACINGS = 2.0  # neighbours among single sites are at most 1.35 apart (ribbons.py)
_ASKED = 24  # so many particles lie in reach, rim and own face included
_FLATNESS, _SAME_SHEET = 0.5, 0.7  # as in ribbons.py: the leaf above is another sheet
_ONE_SIDED = 0.2  # of the offsets' mean length: how far the middle of a site's particles is from the site's middle


def cross_section_means(continuum: Continuum, *, frame: Frame) -> sparse.csr_matrix:
    """Weights [P, P] that give each particle the mean of a quantity over the cross-section that it belongs to.

    Rows sum to one. Particles of solids and those whose other side is not found keep their own value.

    Args:
        continuum: P particles.
        frame: input coordinates -> metres.
    """
    p = len(continuum)
    thin = np.flatnonzero(continuum.shape != SOLID)
    offset_m = continuum.offset_m
    key = np.stack([continuum.site, continuum.part, continuum.piece], 1)[thin]  # other pieces may go other ways
    _, first, of_thin = np.unique(key, axis=0, return_index=True, return_inverse=True)
    site = np.arange(p)
    site[thin] = thin[first][of_thin.ravel()]  # the site's first particle stands for it
    of_site = sparse.csr_matrix((1 / np.bincount(site)[site], (site, np.arange(p))), shape=(p, p))
    lopsided_m = np.linalg.norm((of_site @ offset_m)[site], axis=1)
    one_sided = lopsided_m > _ONE_SIDED * (of_site @ np.linalg.norm(offset_m, axis=1))[site]

    sheet = thin[continuum.shape[thin] == SHEET]
    opposite = _opposite(continuum, frame, sheet[one_sided[sheet]], sheet)
    found = np.asarray(opposite.sum(1)).ravel()
    other_face = sparse.diags(0.5 / np.maximum(found, 1)) @ opposite
    own = np.where(one_sided, np.where(found > 0, 0.5, 1.0), 0.0)
    return sparse.csr_matrix(
        sparse.diags(np.where(one_sided, 0.0, 1.0)) @ of_site[site] + sparse.diags(own) + other_face
    )


def _opposite(
    continuum: Continuum, frame: Frame, alone: NDArray[np.intp], sheet: NDArray[np.intp]
) -> sparse.csr_matrix:
    """Ones [P, P] at the nearest particles on the other face of the same sheet, of each that stands alone."""
    p = len(continuum)
    if len(alone) == 0:
        return sparse.csr_matrix((p, p))
    middle_m = frame.to_metres(continuum.positions) - continuum.offset_m
    reach_m = _REACH_SPACINGS * continuum.spacing_m
    distance, near = KDTree(middle_m[sheet]).query(
        middle_m[alone], k=min(_ASKED, len(sheet)), distance_upper_bound=reach_m, workers=-1
    )
    distance = distance.reshape(len(alone), -1)
    row, column = np.nonzero(np.isfinite(distance))
    one, other = alone[row], sheet[near.reshape(distance.shape)[row, column]]
    offset_m = continuum.offset_m
    normal = offset_m / np.maximum(np.linalg.norm(offset_m, axis=1, keepdims=True), 1e-300)
    rise_m = np.abs(((middle_m[other] - middle_m[one]) * normal[one]).sum(1))
    found = (normal[one] * normal[other]).sum(1) < -_SAME_SHEET
    found &= rise_m <= _FLATNESS * distance[row, column]
    found &= (continuum.part[one] == continuum.part[other]) & (continuum.piece[one] == continuum.piece[other])
    one, other = one[found], other[found]
    row = row[found]
    rank = np.arange(len(row)) - np.searchsorted(row, row)  # nearest first
    one, other = one[rank < _OPPOSITE], other[rank < _OPPOSITE]
    return sparse.csr_matrix((np.ones(len(one)), (one, other)), shape=(p, p))
