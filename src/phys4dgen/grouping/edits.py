"""Corrections of the parts that a person asks for: parts merged, renamed, split, or pointed at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.errors import StageError, did_you_mean
from phys4dgen.grouping.appearance import parts_from_seeds
from phys4dgen.grouping.merging import MergeTree
from phys4dgen.grouping.split import split_part
from phys4dgen.scene import PartEdit
from phys4dgen.types import Frame, Gaussians, Parts

__all__ = ["edited_parts", "merge_parts", "rename_part"]


def edited_parts(
    parts: Parts, edit: PartEdit, *, gaussians: Gaussians, frame: Frame, tree: Callable[[], MergeTree]
) -> Parts:
    """The parts after one edit of a scene.

    Args:
        parts: before the edit.
        edit: what to do.
        gaussians: N static Gaussians.
        frame: which way is up.
        tree: returns the merge tree of the Gaussians' surface; called for splits and seeds alone.

    Raises:
        StageError: the edit speaks of a part that does not exist, gives a name twice, or cannot be made.
    """
    if edit.rename is not None and edit.to is not None:
        return rename_part(parts, edit.rename, edit.to)
    if edit.merge:
        return merge_parts(parts, edit.merge)
    graph = tree().graph
    seeds = {name: _nearest(points, gaussians, graph.patch) for name, points in edit.seeds.items()}
    if edit.split is None:
        return parts_from_seeds(graph, gaussians, frame, seeds)
    return split_part(
        parts, edit.split, graph, gaussians=gaussians, frame=frame, pieces=edit.pieces or 2, seeds=seeds or None
    )


def merge_parts(parts: Parts, names: Sequence[str]) -> Parts:
    """Several parts as one, which keeps the first name and the lowest of their numbers; the others close the gaps.

    Raises:
        StageError: there is no part of one of the names.
    """
    numbers = [_number(parts, name) for name in names]
    target = min(numbers)
    gone = set(numbers) - {target}
    kept = [number for number in range(parts.count) if number not in gone]
    renumbered = np.zeros(parts.count, np.int32)
    renumbered[kept] = np.arange(len(kept), dtype=np.int32)
    renumbered[list(gone)] = renumbered[target]
    new_names = tuple(names[0] if number == target else parts.names[number] for number in kept)
    return replace(parts, labels=renumbered[parts.labels], names=new_names)


def rename_part(parts: Parts, name: str, to: str) -> Parts:
    """The same parts, one under another name.

    Raises:
        StageError: there is no such part, or another one has the new name already.
    """
    number = _number(parts, name)
    if to in parts.names and to != name:
        raise StageError(f"grouping.edits: '{name}' cannot be called '{to}', which another part is called already.")
    names = tuple(to if i == number else old for i, old in enumerate(parts.names))
    return replace(parts, names=names)


def _nearest(points: Sequence[tuple[float, float, float]], gaussians: Gaussians, patch: NDArray[np.int32]) -> list[int]:
    """Index of the Gaussian of the visible surface nearest to each point."""
    visible = np.flatnonzero(patch >= 0)
    return visible[KDTree(gaussians.means[visible]).query(np.array(points))[1]].tolist()


def _number(parts: Parts, name: str) -> int:
    if name not in parts.names:
        raise StageError(
            f"grouping.edits: there is no part '{name}' at this point; the parts are {', '.join(parts.names)}."
            f"{did_you_mean(name, parts.names)}"
        )
    return parts.names.index(name)
