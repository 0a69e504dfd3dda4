"""The part of every Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["Parts"]


@dataclass(frozen=True, eq=False)
class Parts:
    """One label per Gaussian, parts numbered from the ground up.

    Attributes:
        labels: shape [N], int32, 0 .. G-1, every part has at least one Gaussian.
        names: G unique names.
        backend: what made the parts, for the report ("file", "appearance (stand-in for SAM2)" ...).
        votes: what the views voted for, before parts were edited, shape [N, L], float32; None where there was no vote.
        visible: seen in at least one view, shape [N]; None where no views were used.
    """

    labels: NDArray[np.int32]
    names: tuple[str, ...]
    backend: str
    votes: NDArray[np.float32] | None = None
    visible: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        labels = checked_array(self.labels, "labels", (None,), np.int32)
        found = np.unique(labels)
        if len(found) != len(self.names) or found[0] != 0 or found[-1] != len(self.names) - 1:
            raise ValueError(
                f"labels: expected every part 0 .. {len(self.names) - 1} to own a Gaussian, got parts {found.tolist()}."
            )
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"names: expected unique part names, got {list(self.names)}.")
        object.__setattr__(self, "labels", labels)
        if self.votes is not None:
            object.__setattr__(self, "votes", checked_array(self.votes, "votes", (len(labels), None), np.float32))
        if self.visible is not None:
            object.__setattr__(self, "visible", checked_array(self.visible, "visible", (len(labels),), np.bool_))

    @property
    def count(self) -> int:
        """Number of parts G."""
        return len(self.names)
