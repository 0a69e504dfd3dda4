"""Whether colour and shape can tell the parts of an object at all: what a report should say of parts by appearance."""

from __future__ import annotations

from phys4dgen.grouping.cutting import LEVEL, cut_tree
from phys4dgen.grouping.merging import MergeTree

__all__ = ["reason_to_doubt"]

_MARGIN = 0.05
"""Parts that another level of the cut, by so much higher or lower, would change hang on a thread."""


def reason_to_doubt(tree: MergeTree, found: int, *, wanted: int | None = None) -> str | None:
    """Why the parts that were cut from a tree may not be those a person would name; None where nothing speaks for it.

    Wrong parts need not be doubtful: two things of one colour are one part with a wide margin.

    Args:
        tree: from ``appearance_tree``.
        found: number of parts.
        wanted: number that was asked for, if any.
    """
    if wanted is not None:
        return f"{wanted} parts were asked for, but colour and shape hold only {found}" if found < wanted else None
    if found == 1:
        return "no two regions differ enough in colour and shape to be two parts"
    finer, coarser = (int(cut_tree(tree, level=LEVEL * factor).max()) + 1 for factor in (1 - _MARGIN, 1 + _MARGIN))
    if finer != coarser:
        return f"colour and shape hardly tell whether they are {coarser} or {finer}"
    return None
