"""Which patches of one colour a crease keeps apart, whether they touch or not.

A scrap of a handset and a scrap of the telephone it lies on look the same and do not touch; by colour alone they would
join, and from then on handset and telephone would be one region, whatever the crease between them. The surface is
therefore looked at as a network of resistors (Klein and Randic, "Resistance Distance", J. Math. Chem. 12, 1993):
patches that touch are joined by a conductor, poor over an edge of colour. The same network is built a second time with
conductors that creases make poor too. Two patches within one smooth surface lie as far apart in the one as in the
other; across a crease the second distance is longer. All ways count, so that one leak in a crease hardly matters.
Patches that no way of one colour joins (petals about a flower's heart, two halves of a bun) say nothing of creases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from phys4dgen.grouping.patch_graph import PatchGraph
from phys4dgen.grouping.regions import folds_between

__all__ = ["crease_detours"]

_EDGE_SCALE = 5.0
"""Difference between touching patches, in units of colour, at which a conductor becomes poor."""
_CREASE = 40.0
"""Difference that a full concave crease is worth."""
_OVER_ANY_EDGE = 1e-6
"""Least conductance of a border, where 1 is one within a material."""
_TO_GROUND = 1e-6
"""Conductance from each patch to a common ground, without which what touches nothing would lie infinitely far away."""
_ONE_COLOR = 10.0
"""Resistance from which two patches are not joined by a way of one colour; within a part it is 0.5 to 5."""


def crease_detours(graph: PatchGraph, region: NDArray[np.int64]) -> NDArray[np.float64]:
    """Logarithm of how much longer creases make the way between two patches of one colour; symmetric, shape [S, S].

    0 within one smooth surface and where no way of one colour joins the two; 0.2 to 1.5 across a crease.

    Args:
        graph: S patches.
        region: small regions of some patches each, between which creases are measured with less noise, shape [S].
    """
    i, j = graph.touching.T
    length = graph.border / np.median(graph.border) if len(graph.border) else graph.border
    color = ((graph.feature[i] - graph.feature[j]) ** 2).sum(1)
    fold = graph.crease.copy()
    between = np.flatnonzero(region[i] != region[j])
    fold[between] = folds_between(graph, region, between)
    crease = (_CREASE * np.clip(fold, 0, 1)) ** 2
    by_color, with_creases = (
        _resistance(len(graph), i, j, length * (np.exp(-difference / (2 * _EDGE_SCALE**2)) + _OVER_ANY_EDGE))
        for difference in (color, color + crease)
    )
    by_color = np.maximum(by_color, 1e-9)
    joined = 1 / (1 + (by_color / _ONE_COLOR) ** 4)
    return joined * np.log(np.maximum(with_creases / by_color, 1))


def _resistance(
    count: int, i: NDArray[np.int32], j: NDArray[np.int32], conductance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Resistance between any two of ``count`` nodes, by the inverse of the network's Laplacian; shape [S, S]."""
    everyone = np.arange(count)
    total = np.bincount(i, conductance, count) + np.bincount(j, conductance, count) + _TO_GROUND
    rows, columns = np.concatenate([i, j, everyone]), np.concatenate([j, i, everyone])
    laplacian = coo_matrix((np.concatenate([-conductance, -conductance, total]), (rows, columns))).tocsc()
    # A sparse factorisation gives the same bits for any number of threads, which a dense inverse does not.
    potential = splu(laplacian, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(np.eye(count))
    potential = (potential + potential.T) / 2
    own = np.diag(potential)
    return own[:, None] + own[None] - 2 * potential
