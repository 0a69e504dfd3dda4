"""Names that a user gives on a picture of the object reach its parts.

Every view is compared with the picture by colour and shape; in the one that resembles it most, segments and parts are
matched, by CLIP's embeddings of the masked sub-images where there is a CLIP (Paper: Sec. 3.4, Eq. for the best match;
here with one part per segment, a floor, and the margin reported), else by the same descriptor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.clip import ClipEncoder, masked_sub_image
from phys4dgen.errors import StageError
from phys4dgen.grouping.correspondence.assignment import best_matches
from phys4dgen.grouping.correspondence.descriptor import (
    DESCRIPTOR_FLOOR,
    descriptor_similarity,
    segment_descriptors,
)

__all__ = ["NamedSegments", "PartNaming", "name_parts_by_picture"]

_CLIP_FLOOR = 0.6
"""Least cosine of two CLIP embeddings of one part; from memory of natural pictures, not measured."""
_MIN_SHARE = 0.002
"""Of a view's foreground: a part that shows less is not compared."""


@dataclass(frozen=True, eq=False)
class NamedSegments:
    """A picture and the segments that its user has named.

    Attributes:
        rgb: shape [H, W, 3], uint8.
        segments: number of each pixel's segment, -1 for background, shape [H, W].
        names: by number of segment.
    """

    rgb: NDArray[np.uint8]
    segments: NDArray[np.int32]
    names: Mapping[int, str]


@dataclass(frozen=True)
class PartNaming:
    """What a picture says about one segment.

    Attributes:
        name: of the segment.
        part: number of the part that it is, or None where none resembles it enough.
        similarity: of the two.
        margin: by how much the part is more alike than the next.
    """

    name: str
    part: int | None
    similarity: float = 0.0
    margin: float = 0.0


def name_parts_by_picture(
    named: NamedSegments,
    views: Sequence[NDArray[np.uint8]],
    part_maps: Sequence[NDArray[np.int32]],
    *,
    encoder: ClipEncoder | None = None,
) -> tuple[list[PartNaming], int]:
    """Find the part that each named segment shows.

    Args:
        named: the picture.
        views: of the object, each of shape [H, W, 3].
        part_maps: part number of each pixel of the views, -1 for background.
        encoder: CLIP, or None for colour and shape.

    Returns:
        One entry per named segment, in the order of ``names``, and the number of the view that was compared.

    Raises:
        StageError: a named segment has no pixels, or no view shows a part.
    """
    numbers = np.array(list(named.names), np.int64)
    absent = [number for number in numbers.tolist() if not (named.segments == number).any()]
    if absent:
        raise StageError(
            f"grouping.named_picture: segment {absent[0]} ('{named.names[absent[0]]}') has no pixel in segments; give "
            "names to numbers that are there."
        )
    mine = segment_descriptors(named.rgb, named.segments, numbers)
    best_view, best_sum, similarity, shown = -1, -1.0, np.zeros((len(numbers), 0)), np.zeros(0, np.int64)
    for place, (rgb, part_map) in enumerate(zip(views, part_maps, strict=True)):
        parts = _shown_parts(part_map)
        if not len(parts):
            continue
        alike = descriptor_similarity(mine, segment_descriptors(rgb, part_map, parts))
        total = sum(match.similarity for match in best_matches(alike, floor=0.0))
        if total > best_sum:
            best_view, best_sum, similarity, shown = place, total, alike, parts
    if best_view < 0:
        raise StageError("grouping.named_picture: no view of the object shows a part.")
    floor = DESCRIPTOR_FLOOR
    if encoder is not None:
        floor = _CLIP_FLOOR
        similarity = _clip_similarity(encoder, named, numbers, views[best_view], part_maps[best_view], shown)
    found = {match.row: match for match in best_matches(similarity, floor=floor)}
    names = list(named.names.values())
    return [
        PartNaming(name, int(shown[found[row].column]), found[row].similarity, found[row].margin)
        if row in found
        else PartNaming(name, None, float(similarity[row].max()))
        for row, name in enumerate(names)
    ], best_view


def _shown_parts(part_map: NDArray[np.int32]) -> NDArray[np.int64]:
    """Numbers of the parts that a view shows enough of."""
    numbers, counts = np.unique(part_map[part_map >= 0], return_counts=True)
    return numbers[counts >= _MIN_SHARE * counts.sum()].astype(np.int64)


def _clip_similarity(
    encoder: ClipEncoder,
    named: NamedSegments,
    numbers: NDArray[np.int64],
    rgb: NDArray[np.uint8],
    part_map: NDArray[np.int32],
    parts: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Cosines of the embeddings of named segments and parts of one view, shape [segments, parts]."""
    segments = encoder.pictures([masked_sub_image(named.rgb, named.segments == number) for number in numbers])
    shown = encoder.pictures([masked_sub_image(rgb, part_map == number) for number in parts])
    return (segments @ shown.T).astype(np.float64)
