"""One part divided further, by its own appearance or by clicks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError, did_you_mean
from phys4dgen.grouping.attach import attach, number_from_the_ground
from phys4dgen.grouping.clicked import parts_by_random_walk
from phys4dgen.grouping.cutting import cut_tree
from phys4dgen.grouping.merging import merge_tree
from phys4dgen.grouping.patch_graph import PatchGraph
from phys4dgen.grouping.seeds import seed_patches
from phys4dgen.grouping.supervoxels import object_radius
from phys4dgen.types import Frame, Gaussians, Parts

__all__ = ["split_part", "with_pieces"]


def split_part(
    parts: Parts,
    name: str,
    graph: PatchGraph,
    *,
    gaussians: Gaussians,
    frame: Frame,
    pieces: int = 2,
    seeds: Mapping[str, Sequence[int]] | None = None,
) -> Parts:
    """Divide one part; all others stay as they are.

    Args:
        parts: the parts, from whatever backend.
        name: of the part to divide.
        graph: patches of the same Gaussians' surface, from the merge tree.
        gaussians: N static Gaussians.
        frame: which way is up.
        pieces: how many; they are called ``NAME_1``, ``NAME_2`` ... from the ground up. Not used with ``seeds``.
        seeds: by the name of each piece, indices of one or more Gaussians of it. With a single one the piece that it
            points at gets that name, and the rest keeps its own.

    Returns:
        All parts, numbered from the ground up.

    Raises:
        StageError: there is no such part, it cannot be divided so far, a click misses it, or a name is taken.
    """
    if name not in parts.names:
        raise StageError(
            f"grouping.edits: there is no part '{name}' to split; the parts are {', '.join(parts.names)}."
            f"{did_you_mean(name, parts.names)}"
        )
    rows = np.flatnonzero(parts.labels == parts.names.index(name))
    patches = _patches_of(graph, rows)
    wanted = max(pieces, 2) if not seeds else max(len(seeds), 2)
    if len(patches) < wanted:
        raise StageError(
            f"grouping.edits: '{name}' shows too little surface to be split into {wanted}; leave it whole."
        )
    inside = graph.subset(patches)
    if seeds:
        piece_of_patch, names = _by_seeds(inside, gaussians, rows, name=name, seeds=seeds)
    else:
        piece_of_patch = cut_tree(merge_tree(inside), wanted)
        names = [f"{name}_{number}" for number in range(1, int(piece_of_patch.max()) + 2)]
    taken = [other for other in names if other != name and other in parts.names]
    if taken:
        raise StageError(f"grouping.edits: a piece of '{name}' cannot be called '{taken[0]}': there is such a part.")
    own = gaussians.subset(rows)
    piece = attach(own, inside.patch[rows], piece_of_patch, color=inside.color[rows], radius=object_radius(gaussians))
    found = len(np.unique(piece))
    if found < wanted:
        cure = "click on larger ones" if seeds else "ask for fewer, or click on each piece instead (--seed)"
        raise StageError(
            f"grouping.edits: '{name}' holds only {found} of {wanted} pieces large enough to be parts; {cure}."
        )
    if not seeds:
        piece = number_from_the_ground(piece, own, frame)[0]
    return with_pieces(parts, rows, piece, name=name, names=names, gaussians=gaussians, frame=frame)


def _patches_of(graph: PatchGraph, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The patches more than half of whose Gaussians are among ``rows``."""
    count = len(graph)
    all_of = np.bincount(graph.patch[graph.patch >= 0], minlength=count)
    patch = graph.patch[rows]
    return np.flatnonzero(2 * np.bincount(patch[patch >= 0], minlength=count) > all_of)


def _by_seeds(
    inside: PatchGraph,
    gaussians: Gaussians,
    rows: NDArray[np.intp],
    *,
    name: str,
    seeds: Mapping[str, Sequence[int]],
) -> tuple[NDArray[np.int64], list[str]]:
    """Piece of every patch and the names of the pieces, where the user has clicked on one or more of them."""
    for piece, clicked in seeds.items():
        missed = np.setdiff1d(np.asarray(clicked), rows)
        if len(missed):
            raise StageError(f"grouping.edits: the click for '{piece}' falls on another part than '{name}'.")
    known = seed_patches(inside, gaussians, seeds)
    if len(seeds) > 1:
        return parts_by_random_walk(inside, known), list(seeds)
    half = cut_tree(merge_tree(inside), 2)
    clicked_half = half[np.flatnonzero(known >= 0)[0]]
    return np.where(half == clicked_half, 0, 1), [next(iter(seeds)), name]


def with_pieces(
    parts: Parts,
    rows: NDArray[np.intp],
    piece: NDArray[np.integer],
    *,
    name: str,
    names: Sequence[str],
    gaussians: Gaussians,
    frame: Frame,
) -> Parts:
    """The parts with the Gaussians ``rows`` of part ``name`` divided into pieces.

    Args:
        parts: before.
        rows: all Gaussians of the part.
        piece: number of the piece of each of them.
        name: of the part.
        names: of the pieces, one of which may be that of the part.
        gaussians: N static Gaussians.
        frame: which way is up.
    """
    all_names = [*parts.names, *names]  # the old name stays in its place without Gaussians, unless a piece bears it
    labels = parts.labels.astype(np.int64)
    labels[rows] = parts.count + piece
    numbered, old = number_from_the_ground(labels, gaussians, frame)
    return replace(parts, labels=numbered, names=tuple(all_names[number] for number in old))
