"""Accelerations as the velocity that grid and parts gain in each substep.

An acceleration of everything acts on the grid; an acceleration of one part is added to the momentum that the part's
particles give to the grid, so that held nodes resist it. Windows are integrated exactly over each substep.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.settings import Settings

__all__ = ["peak_acceleration_ms2", "velocity_gains_ms"]


def velocity_gains_ms(
    settings: Settings, times_s: NDArray[np.float64], part_count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocity gained by everything [S, 3], and by each part on its own [S, parts, 3], in S substeps, m/s.

    ``times_s`` holds the S + 1 times that bound the substeps.
    """
    everything = np.diff(times_s)[:, None] * np.asarray(settings.gravity_ms2, np.float64)
    parts = np.zeros((len(times_s) - 1, part_count, 3))
    for acceleration in settings.accelerations:
        gain = np.diff(acceleration.integral(times_s))[:, None] * np.asarray(acceleration.value_ms2, np.float64)
        if acceleration.part is None:
            everything += gain
        else:
            parts[:, acceleration.part] += gain
    return everything, parts


def peak_acceleration_ms2(settings: Settings, from_s: float, to_s: float) -> float:
    """An upper bound of the acceleration that loads cause between two times."""
    active = [a.value_ms2 for a in settings.accelerations if a.from_s < to_s and a.to_s > from_s]
    return float(sum(np.linalg.norm(value) for value in [settings.gravity_ms2, *active]))
