"""Frequencies and slopes of simulated signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["frequency_hz"]


def frequency_hz(signal: NDArray[np.float64], frame_time_s: float) -> float:
    """Mean frequency of an oscillation [N] from its interpolated upward zero crossings.

    Raises:
        ValueError: it does not swing at least once.
    """
    s = signal - signal.mean()
    up = np.flatnonzero((s[:-1] < 0) & (s[1:] >= 0))
    if len(up) < 2:
        raise ValueError(f"the signal of {len(s)} frames crosses its mean upwards {len(up)} times, expected 2 or more.")
    crossings = up + s[up] / (s[up] - s[up + 1])
    return float(1 / (np.diff(crossings).mean() * frame_time_s))
