"""One row of the rule table, and the colours that several rows speak of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from phys4dgen.materials.features import PartFeatures

__all__ = ["Neighbours", "Rule", "is_brown", "is_green"]

Neighbours = Mapping[str, PartFeatures]


@dataclass(frozen=True)
class Rule:
    """One row of the rule table.

    Attributes:
        name: short name for the report.
        says: the observation in words.
        material: library name that it concludes; empty for the part's own name.
        confidence: how often it is expected to be right where it applies, 0 to 1; an estimate, not a measurement.
        example: what it was made for.
        counter_example: what it would get wrong.
        applies: the observation, from the part's features and those of all parts by name.
    """

    name: str
    says: str
    material: str
    confidence: float
    example: str
    counter_example: str
    applies: Callable[[PartFeatures, Neighbours], bool]


def is_green(part: PartFeatures) -> bool:
    """The green of leaves."""
    return 95 <= part.hue_deg <= 185 and part.chroma > 6


def is_brown(part: PartFeatures) -> bool:
    """The brown of bark."""
    return 25 <= part.hue_deg <= 90 and part.chroma > 6 and part.lightness < 55
