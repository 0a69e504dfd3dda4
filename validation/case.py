"""What a benchmark is: a function that simulates something whose answer is known, and says how far off the engine is.

Each module of this package is one family of benchmarks; a function becomes one with ``@benchmark``. Its docstring says
what is simulated and goes on the page.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from validation.chart import Chart
from validation.states import States

__all__ = ["BENCHMARKS", "Benchmark", "Check", "Outcome", "benchmark"]


@dataclass(frozen=True)
class Check:
    """One measured number and what it may be.

    Attributes:
        what: the quantity, with its unit.
        measured: by the engine.
        low, high: what it may be, both included.
        expected: by theory or experiment; None where only a bound is known.
        relative: the error is a share of ``expected``.
    """

    what: str
    measured: float
    low: float = -math.inf
    high: float = math.inf
    expected: float | None = None
    relative: bool = False

    @classmethod
    def share(cls, what: str, measured: float, *, expected: float, tolerance: float) -> Check:
        """May differ by a share of what is expected."""
        reach = abs(expected) * tolerance
        return cls(what, float(measured), expected - reach, expected + reach, expected, True)

    @classmethod
    def near(cls, what: str, measured: float, *, expected: float, tolerance: float) -> Check:
        """May differ by an amount."""
        return cls(what, float(measured), expected - tolerance, expected + tolerance, expected)

    @classmethod
    def between(cls, what: str, measured: float, *, low: float = -math.inf, high: float = math.inf) -> Check:
        """May lie in a range."""
        return cls(what, float(measured), low, high)

    @property
    def passed(self) -> bool:
        """Whether it is what it may be; NaN is not."""
        return self.low <= self.measured <= self.high

    @property
    def error(self) -> float | None:
        """Measured minus expected, over expected where ``relative``; None without ``expected``."""
        if self.expected is None:
            return None
        off = self.measured - self.expected
        return off / abs(self.expected) if self.relative else off

    def texts(self) -> tuple[str, str, str, str]:
        """Expected, measured, error and tolerance as a table shows them."""
        measured = _number(self.measured)
        low, high = math.isfinite(self.low), math.isfinite(self.high)
        error = self.error
        if self.expected is None or error is None:
            bounds = [f">= {_number(self.low)}"] * low + [f"<= {_number(self.high)}"] * high
            return " and ".join(bounds) or "-", measured, "-", "-" if bounds else "report only"
        show = _share if self.relative else _number
        reach = (self.high - self.low) / 2 / (abs(self.expected) if self.relative else 1.0)
        return _number(self.expected), measured, show(error), show(reach).lstrip("+") if low and high else "report only"


def _number(value: float) -> str:
    return f"{value:.4g}"


def _share(value: float) -> str:
    percent = 100 * value
    return f"{percent:+.1e} %" if 0 < abs(percent) < 0.01 else f"{percent:+.3g} %"


@dataclass(frozen=True)
class Outcome:
    """What a benchmark found.

    Attributes:
        checks: numbers and limits.
        charts: curves beside theory.
        states: drawings of the simulated matter.
    """

    checks: tuple[Check, ...]
    charts: tuple[Chart, ...] = ()
    states: tuple[States, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every check did."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Benchmark:
    """A benchmark with its variants.

    Attributes:
        key: B1 to B21, as on the page.
        title: a few words.
        run: simulates one variant.
        source: of what is expected.
        variants: keyword arguments of ``run`` by the variant's name.
        in_tests: names of the variants that are quick enough for ``make test``.
    """

    key: str
    title: str
    run: Callable[..., Outcome]
    source: str
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"": {}})
    in_tests: tuple[str, ...] = ()

    @property
    def setup(self) -> str:
        """What is simulated: the docstring of ``run``."""
        return inspect.cleandoc(self.run.__doc__ or "")


BENCHMARKS: dict[str, Benchmark] = {}
"""Every benchmark by its key, in the order of the modules; ``validation.suite`` imports them."""


def benchmark(
    key: str,
    title: str,
    *,
    source: str,
    variants: Mapping[str, Mapping[str, Any]] | None = None,
    in_tests: tuple[str, ...] = (),
) -> Callable[[Callable[..., Outcome]], Callable[..., Outcome]]:
    """Make a function a benchmark; see ``Benchmark``."""

    def enter(run: Callable[..., Outcome]) -> Callable[..., Outcome]:
        if key in BENCHMARKS:
            raise ValueError(f"benchmark {key} is defined twice.")
        BENCHMARKS[key] = Benchmark(key, title, run, source, variants or {"": {}}, in_tests)
        return run

    return enter
