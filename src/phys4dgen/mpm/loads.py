"""Loads that are the same all over what they act on: accelerations, total forces and blows, over time windows.

What depends on where a particle is or how fast it moves stands in ``fields.py``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.mpm.body import Body

__all__ = ["Acceleration", "Impulse", "Load", "Selection", "TotalForce", "UniformLoad", "checked_vector"]

Vector = tuple[float, float, float]


def checked_vector(values: Sequence[float] | NDArray[np.float64], name: str) -> Vector:
    """Three finite numbers as floats; ValueError names ``name`` otherwise."""
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name}: expected three finite numbers, got {values}.")
    x, y, z = (float(value) for value in values)
    return x, y, z


@dataclass(frozen=True, eq=False, kw_only=True)
class Selection:
    """Which particles of a body are meant; held ones never are.

    Attributes:
        part: part number, or None for all parts.
        chosen: True for particles that are meant besides, shape [P], bool; None: all.
    """

    part: int | None = None
    chosen: NDArray[np.bool_] | None = None

    def selects(self, body: Body) -> NDArray[np.bool_]:
        """The particles of ``body`` that are meant, [P].

        Raises:
            SimulationError: the body has no such part, or another number of particles.
        """
        if self.part is not None and not 0 <= self.part < len(body.part_names):
            raise SimulationError(
                f"{type(self).__name__} names part {self.part}; the body has parts 0 to {len(body.part_names) - 1} "
                f"({', '.join(body.part_names)})."
            )
        meant = ~body.held if self.part is None else ~body.held & (body.part == self.part)
        if self.chosen is None:
            return meant
        if self.chosen.shape != meant.shape:
            raise SimulationError(f"chosen: expected {len(meant)} values, one per particle, got {self.chosen.shape}.")
        return meant & self.chosen

    @property
    def is_everything(self) -> bool:
        """Whether all that moves is meant."""
        return self.part is None and self.chosen is None


@dataclass(frozen=True, eq=False, kw_only=True)
class Load(Selection):
    """Something that acts on particles during a time window.

    Attributes:
        from_s, to_s: the window.
        ramp_s: it rises as sin^2 during the first and falls during the last so many seconds of the window.
    """

    from_s: float = 0.0
    to_s: float = math.inf
    ramp_s: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.from_s) and self.from_s < self.to_s):
            raise ValueError(f"from_s, to_s: expected from_s < to_s, got {self.from_s} and {self.to_s}.")
        if not 0 <= 2 * self.ramp_s <= self.to_s - self.from_s:
            raise ValueError(f"ramp_s: expected at most half of the window, got {self.ramp_s}.")

    def open_s(self, times_s: Any) -> NDArray[np.float64]:
        """Seconds that the window was open up to each time, weighted by how far; same shape as ``times_s``."""
        times = np.asarray(times_s, np.float64)
        rising = self._risen_s(times - self.from_s)
        if math.isinf(self.to_s):
            return rising
        # the fall is the rise seen from the end: what is missing to full from then on
        full = np.maximum(times - (self.to_s - self.ramp_s), 0)
        return rising - self._risen_s(full)

    def _risen_s(self, since_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The integral of a step that rises during ``ramp_s``."""
        ramp = self.ramp_s
        if ramp == 0:
            return np.maximum(since_s, 0)
        inside = np.clip(since_s, 0, ramp)
        return inside / 2 - ramp / (2 * np.pi) * np.sin(np.pi * inside / ramp) + np.maximum(since_s - ramp, 0)


class UniformLoad(Load, ABC):
    """A load that gives all of its particles the same velocity."""

    @abstractmethod
    def gained_ms(self, times_s: Any, mass_kg: float) -> NDArray[np.float64]:
        """Velocity gained up to each time by particles that weigh ``mass_kg`` together, [.., 3]."""

    @abstractmethod
    def peak_ms2(self, mass_kg: float) -> float:
        """The largest acceleration, without blows."""


@dataclass(frozen=True, eq=False)
class Acceleration(UniformLoad):
    """An acceleration, as weight is.

    Attributes:
        value_ms2: while the window is fully open, m/s2.
    """

    value_ms2: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "value_ms2", checked_vector(self.value_ms2, "value_ms2"))

    def gained_ms(self, times_s: Any, mass_kg: float) -> NDArray[np.float64]:
        """See ``UniformLoad``."""
        return self.open_s(times_s)[..., None] * np.array(self.value_ms2)

    def peak_ms2(self, mass_kg: float) -> float:
        """See ``UniformLoad``."""
        return float(np.linalg.norm(self.value_ms2))


@dataclass(frozen=True, eq=False)
class TotalForce(UniformLoad):
    """A force on all of its particles together, shared in proportion to their masses: a = f / M.

    Attributes:
        value_n: while the window is fully open, N.
    """

    value_n: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "value_n", checked_vector(self.value_n, "value_n"))

    def gained_ms(self, times_s: Any, mass_kg: float) -> NDArray[np.float64]:
        """See ``UniformLoad``."""
        return self.open_s(times_s)[..., None] * np.array(self.value_n) / mass_kg

    def peak_ms2(self, mass_kg: float) -> float:
        """See ``UniformLoad``."""
        return float(np.linalg.norm(self.value_n)) / mass_kg


@dataclass(frozen=True, eq=False)
class Impulse(UniformLoad):
    """Momentum given at one time, ``from_s``, shared in proportion to the masses.

    Attributes:
        value_ns: N s.
    """

    value_ns: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "value_ns", checked_vector(self.value_ns, "value_ns"))

    def gained_ms(self, times_s: Any, mass_kg: float) -> NDArray[np.float64]:
        """See ``UniformLoad``: nothing up to ``from_s``, everything after it."""
        given = (np.asarray(times_s, np.float64) > self.from_s).astype(np.float64)
        return given[..., None] * np.array(self.value_ns) / mass_kg

    def peak_ms2(self, mass_kg: float) -> float:
        """See ``UniformLoad``."""
        return 0.0
