"""Many answers about one part become one: a vote on the material first, then medians inside the winner.

Means are pulled up by single stiff answers (the paper's scarf: mean 8.22, median 7.70 decades of pascals), and a
median over all answers mixes materials; so numbers are medians of logarithms over those who named the winner.
Agreement is reported as the vote and the spread: the decades that the middle half of the values span.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from phys4dgen.materials.mllm.reading import PartReading, Reading, SideReading

__all__ = ["PartConsensus", "SideConsensus", "middle_half", "part_consensus"]

Origin = Literal["natural", "artificial", "unsure"]
_CLEAR_MAJORITY = 0.8
"""Share of the answers from which a part counts as artificial or natural."""


@dataclass(frozen=True)
class SideConsensus:
    """The material of a surface or an interior that most answers name.

    Attributes:
        material: library name, or the models' own word where the library has none.
        votes: answers that name it.
        of: answers in all.
        rivals: the other materials with their votes, most first.
        law: most named law inside the winner, or None.
        youngs_modulus_pa: median, of logarithms.
        density_kgm3: median, of logarithms.
        poisson_ratio: median.
        spread_decades: of Young's modulus inside the winner.
        extra: medians of the law's other numbers.
    """

    material: str
    votes: int
    of: int
    rivals: tuple[tuple[str, int], ...]
    law: str | None
    youngs_modulus_pa: float
    density_kgm3: float
    poisson_ratio: float
    spread_decades: float
    extra: dict[str, float]

    @property
    def in_words(self) -> str:
        """Vote and spread in one phrase."""
        against = "".join(f", {count} {name}" for name, count in self.rivals[:3])
        return f"{self.votes} of {self.of} answers{against}; E spread {self.spread_decades:.2g} decades"


@dataclass(frozen=True)
class PartConsensus:
    """One part as the answers agree on it.

    Attributes:
        what_it_is: of the first answer that names the winning material.
        reason: likewise.
        origin: natural or artificial where four of five answers say so, else unsure.
        shape: most named, or None.
        thickness_m: median where most answers give one, or None.
        surface, interior: the materials.
    """

    what_it_is: str
    reason: str
    origin: Origin
    shape: str | None
    thickness_m: float | None
    surface: SideConsensus
    interior: SideConsensus


def part_consensus(letter: str, readings: Sequence[Reading]) -> PartConsensus | None:
    """What the answers agree on about a part; None where none of them describes it."""
    parts = [reading.parts[letter] for reading in readings if letter in reading.parts]
    if not parts:
        return None
    surface = _side(parts, lambda part: part.surface)
    speaker = next(part for part in parts if part.surface.material == surface.material)
    thicknesses = [part.thickness_m for part in parts if part.thickness_m is not None]
    return PartConsensus(
        what_it_is=speaker.what_it_is,
        reason=speaker.reason,
        origin=_origin(parts),
        shape=_most([part.shape for part in parts if part.shape]),
        thickness_m=_log_median(thicknesses) if 2 * len(thicknesses) > len(parts) else None,
        surface=surface,
        interior=_side(parts, lambda part: part.interior),
    )


def middle_half(values: Sequence[float]) -> float:
    """Width of the middle half of the values (between the quartiles), 0 for a single one."""
    if len(values) < 2:
        return 0.0
    low, _, high = statistics.quantiles(values, n=4, method="inclusive")
    return high - low


def _side(parts: Sequence[PartReading], of: Callable[[PartReading], SideReading]) -> SideConsensus:
    sides = [of(part) for part in parts]
    votes = Counter(side.material for side in sides)
    typical = statistics.median(math.log10(side.youngs_modulus_pa) for side in sides)

    def rank(name: str) -> tuple[int, float, str]:
        """Most votes; of equals the one nearest to the median stiffness of all answers; then by name."""
        mine = statistics.median(math.log10(side.youngs_modulus_pa) for side in sides if side.material == name)
        return -votes[name], abs(mine - typical), name

    order = sorted(votes, key=rank)
    winners = [side for side in sides if side.material == order[0]]
    keys = sorted({key for side in winners for key in side.extra})
    return SideConsensus(
        material=order[0],
        votes=len(winners),
        of=len(sides),
        rivals=tuple((name, votes[name]) for name in order[1:]),
        law=_most([side.law for side in winners if side.law]),
        youngs_modulus_pa=_log_median([side.youngs_modulus_pa for side in winners]),
        density_kgm3=_log_median([side.density_kgm3 for side in winners]),
        poisson_ratio=statistics.median(side.poisson_ratio for side in winners),
        spread_decades=middle_half([math.log10(side.youngs_modulus_pa) for side in winners]),
        extra={key: _log_median([side.extra[key] for side in winners if key in side.extra]) for key in keys},
    )


def _origin(parts: Sequence[PartReading]) -> Origin:
    said = [part.origin for part in parts if part.origin]
    for origin in ("natural", "artificial"):
        if said and said.count(origin) >= _CLEAR_MAJORITY * len(said):
            return origin
    return "unsure"


def _most(words: Sequence[str]) -> str | None:
    """The most frequent word; of equals the first in the alphabet."""
    counts = Counter(words)
    return min(counts, key=lambda word: (-counts[word], word)) if counts else None


def _log_median(values: Sequence[float]) -> float:
    """Median of logarithms; a value that stands in the middle is returned as it is, to the last bit."""
    ordered = sorted(values)
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else math.sqrt(ordered[middle - 1] * ordered[middle])
