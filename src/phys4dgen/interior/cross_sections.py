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
_REACH_SPACINGS = 2.0
_ASKED = 24
_ONE_SIDED = 0.2  # of its offset: how far the middle of a site's particles lies from the site's middle, at least


def cross_section_means(continuum: Continuum, *, frame: Frame, chosen: NDArray[np.bool_]) -> sparse.csr_matrix:
    """Weights [P, P] that give each chosen particle the mean of a quantity over the cross-section that it belongs to.

    Rows sum to one. Particles that are not chosen, those of solids, and those whose other side is not found keep their
    own value.

    Args:
        continuum: P particles.
        frame: input coordinates -> metres.
        chosen: particles of thin parts whose mean is wanted, [P].
    """
    p = len(continuum)
    thin = np.flatnonzero(chosen & (continuum.shape != SOLID))
    if len(thin) == 0:
        return sparse.identity(p, format="csr")
    offset_m = continuum.offset_m
    of_thin = np.unique(continuum.site[thin], return_inverse=True)[1]
    site = np.arange(p)
    site[thin] = thin[np.unique(of_thin, return_index=True)[1]][of_thin]  # the site's first particle stands for it
    of_site = sparse.csr_matrix((1 / np.bincount(site)[site], (site, np.arange(p))), shape=(p, p))
    lopsided_m = np.linalg.norm((of_site @ offset_m)[site], axis=1)
    one_sided = lopsided_m > _ONE_SIDED * np.linalg.norm(offset_m, axis=1)

    sheet = thin[continuum.shape[thin] == SHEET]
    opposite = _opposite(continuum, frame, sheet[one_sided[sheet]], sheet)
    found = np.asarray(opposite.sum(1)).ravel()
    other_face = sparse.diags(0.5 / np.maximum(found, 1)) @ opposite
    own = np.where(one_sided, np.where(found > 0, 0.5, 1.0), 0.0)
    return (sparse.diags(np.where(one_sided, 0.0, 1.0)) @ of_site[site] + sparse.diags(own) + other_face).tocsr()


def _opposite(
    continuum: Continuum, frame: Frame, alone: NDArray[np.intp], sheet: NDArray[np.intp]
) -> sparse.csr_matrix:
    """Ones [P, P] at the nearest particles on the other face of the same sheet, of each that stands alone."""
    p = len(continuum)
    if len(alone) == 0:
        return sparse.csr_matrix((p, p))
    middle_m = frame.to_metres(continuum.positions) - continuum.offset_m
    distance, near = KDTree(middle_m[sheet]).query(
        middle_m[alone], k=min(_ASKED, len(sheet)), distance_upper_bound=_REACH_SPACINGS * continuum.spacing_m
    )
    distance = distance.reshape(len(alone), -1)
    near = sheet[np.where(np.isfinite(distance), near.reshape(distance.shape), 0)]
    facing = (continuum.offset_m[near] * continuum.offset_m[alone][:, None]).sum(2) < 0
    piece = np.stack([continuum.part, continuum.piece], 1)
    found = np.isfinite(distance) & facing & (piece[near] == piece[alone][:, None]).all(2)
    found &= np.cumsum(found, 1) <= _OPPOSITE
    row, column = np.nonzero(found)
    return sparse.csr_matrix((np.ones(len(row)), (alone[row], near[row, column])), shape=(p, p))
