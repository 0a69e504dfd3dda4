"""All benchmarks, by family; importing this module fills ``case.BENCHMARKS``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from validation import bars, beams, contact, flight, fluids, granular, stability, thin, yielding
from validation.case import BENCHMARKS, Benchmark, Outcome

__all__ = ["FAMILIES", "Ran", "in_order", "run"]

FAMILIES = (flight, beams, bars, contact, stability, fluids, granular, yielding, thin)


@dataclass(frozen=True)
class Ran:
    """One variant of a benchmark that has been run.

    Attributes:
        benchmark, variant: which.
        outcome: what it found.
        seconds: how long it took, compilation too.
    """

    benchmark: Benchmark
    variant: str
    outcome: Outcome
    seconds: float


def in_order() -> list[Benchmark]:
    """All benchmarks by their number."""
    return [BENCHMARKS[key] for key in sorted(BENCHMARKS, key=lambda key: (int(key[1:].rstrip("ab")), key))]


def run(benchmarks: list[Benchmark]) -> Iterator[Ran]:
    """Run all variants of the given benchmarks."""
    for benchmark in benchmarks:
        for variant, keywords in benchmark.variants.items():
            start = time.perf_counter()
            outcome = benchmark.run(**keywords)
            yield Ran(benchmark, variant, outcome, time.perf_counter() - start)
