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
    """

    labels: NDArray[np.int32]
    names: tuple[str, ...]
    backend: str

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

    @property
    def count(self) -> int:
        """Number of parts G."""
        return len(self.names)
