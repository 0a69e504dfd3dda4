"""One partner for each segment at most, the best for all together, and how clear that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["Match", "best_matches"]


@dataclass(frozen=True)
class Match:
    """A row and the column that belongs to it.

    Attributes:
        row: number of the row.
        column: of its partner.
        similarity: of the two.
        margin: by how much the partner is more alike than the next best column; 1 where there is no other.
    """

    row: int
    column: int
    similarity: float
    margin: float


def best_matches(similarity: NDArray[np.float64], *, floor: float) -> list[Match]:
    """The assignment with the largest sum of similarities (Hungarian method) among pairs above a floor.

    Args:
        similarity: shape [R, C].
        floor: pairs below it are never matched.
    """
    # What lies below the floor is worth nothing, so that it takes no partner away from another.
    rows, columns = linear_sum_assignment(-np.where(similarity >= floor, similarity, 0.0))
    found = []
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        value = float(similarity[row, column])
        if value >= floor:
            others = np.delete(similarity[row], column)
            found.append(Match(row, column, value, value - float(others.max()) if len(others) else 1.0))
    return found
