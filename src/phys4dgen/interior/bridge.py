"""Join the pieces into which a capture falls, so that a leaf's tip moves with its leaf.

Gaps of a capture are not gaps of the object: without bridges the loose ends of thin leaves stay in the air while the
leaf moves away, which looks like tearing (MOTION.md, technique 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.morphology import connected_pieces

__all__ = ["BridgeReport", "bridge_pieces"]


@dataclass(frozen=True)
class BridgeReport:
    """What bridging found and did.

    Attributes:
        pieces_before: connected pieces (26-neighbourhood) before.
        pieces_after: connected pieces left after bridging.
        share_in_largest: share of the voxels that lie in the largest piece after bridging.
        bridge_voxels: voxels added.
    """

    pieces_before: int
    pieces_after: int
    share_in_largest: float
    bridge_voxels: int


def bridge_pieces(
    solid: NDArray[np.bool_], *, max_gap_voxels: float = 8.0, min_piece_voxels: int = 4
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], BridgeReport]:
    """Join pieces to the largest one by lines of voxels over gaps, nearest first, until nothing more is in reach.

    Args:
        solid: solid voxels.
        max_gap_voxels: largest gap that is bridged.
        min_piece_voxels: smaller pieces are floaters of the capture and are dropped.

    Returns:
        The bridged solid, the voxels that are bridges, and a report.
    """
    labels, count = connected_pieces(solid)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    before = int((sizes >= min_piece_voxels).sum())
    solid = (sizes >= min_piece_voxels)[labels]
    bridges = np.zeros_like(solid)
    while True:
        labels, count = connected_pieces(solid)
        if count <= 1:
            break
        index = np.argwhere(solid)
        piece = labels[tuple(index.T)]
        sizes = np.bincount(piece, minlength=count + 1)
        main = piece == sizes.argmax()
        distance, nearest = KDTree(index[main]).query(index[~main], distance_upper_bound=max_gap_voxels)
        distance, nearest = np.asarray(distance), np.asarray(nearest)
        reach = np.flatnonzero(np.isfinite(distance))
        if len(reach) == 0:
            break
        # The shortest link of every piece in reach, then all of them at once.
        order = reach[np.argsort(distance[reach], kind="stable")]
        _, first = np.unique(piece[~main][order], return_index=True)
        for link in order[first]:
            start, end = index[~main][link], index[main][nearest[link]]
            steps = int(np.ceil(distance[link])) * 2 + 1
            line = np.round(np.linspace(start, end, steps)).astype(int)
            new = tuple(line.T)
            bridges[new] |= ~solid[new]
            solid[new] = True
    labels, count = connected_pieces(solid)
    sizes = np.bincount(labels.ravel(), minlength=2)
    sizes[0] = 0
    total = int(sizes.sum())
    report = BridgeReport(
        pieces_before=before,
        pieces_after=count,
        share_in_largest=float(sizes.max() / total) if total else 0.0,
        bridge_voxels=int(bridges.sum()),
    )
    return solid, bridges, report
