"""What grouping asks of a network that segments and tracks, whichever it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Proposal", "Segmenter"]

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mask that the network offers for one view.

    Attributes:
        mask: shape [H, W].
        quality: the network's own estimate of its IoU with a thing, about 0 to 1.
    """

    mask: Mask
    quality: float


class Segmenter(Protocol):
    """Segments one view, and follows masks through all views of a smooth path."""

    def propose(self, view: int, region: Mask) -> list[Proposal]:
        """Masks of whatever lies in a region of a view, each best explained by one thing.

        Args:
            view: number of the view on the path.
            region: where to look, shape [H, W]; masks may reach beyond it.
        """
        ...

    def segment(self, view: int, *, points: NDArray[np.float64] | None, box: NDArray[np.float64] | None) -> Proposal:
        """The mask of what a person points at.

        Args:
            view: number of the view on the path.
            points: clicks on the thing, x and y in pixels, shape [K, 2], or None.
            box: left, top, right and bottom in pixels, shape [4], or None.
        """
        ...

    def track(self, view: int, masks: Sequence[Mask]) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Follow masks of one view through the others, forwards and backwards along the path.

        Args:
            view: number of the view that shows the masks.
            masks: O masks of shape [H, W].

        Yields:
            For every view, ``view`` included, its number and logits of shape [O, H, W]: positive inside.
        """
        ...
