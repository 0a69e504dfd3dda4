"""How the kernels see particles and grid in memory.

Particles are float32 columns of one array [columns, stride]; a particle's number is its place along the second
axis. They are ordered by law, then by grid cell, and each law's range is padded with massless particles to a multiple
of ``PADDED_TO``.

Units inside the kernels: metres from a fixed origin, seconds, pascals; mass and volume divided by the body's mean
particle mass, so that node masses are of order one whatever the size of the object.
"""

from __future__ import annotations

from typing import Any

import numba

from phys4dgen.vector.batch import BATCH_LANES, WIDEST_BATCH

__all__ = [
    "AFFINE",
    "AHEAD",
    "DISPLACEMENT_GRADIENT",
    "FUSED",
    "GATHER_ONLY",
    "INDEX",
    "LANES",
    "LAW_COLUMNS",
    "LOAD",
    "MASS",
    "PADDED_TO",
    "POSITION",
    "POSITION_REST",
    "SCATTER_ONLY",
    "SUBSTEP_COLUMNS",
    "VELOCITY",
    "VOLUME",
    "inner_kernel",
    "kernel",
    "parallel_kernel",
    "strict_kernel",
]

LANES = BATCH_LANES
"""Particles that one batch computes side by side."""

AHEAD = 64
"""How many particles ahead columns are fetched: a batch reads 20 to 40 of them, more than a processor foresees itself.

Of 32, 64, 96 and 128 the last three are equally good: a third faster than none once the columns outgrow the cache.
"""

PADDED_TO = WIDEST_BATCH
"""So that particles fall into chunks, and sums come out, as on any other processor."""

POSITION = 0  # 3 columns, m
DISPLACEMENT_GRADIENT = 3  # 9 columns, H = F - I row by row: increments of F near 1 would be rounded away
MASS = 12  # mean particle masses
VOLUME = 13  # rest volume, m3 per mean particle mass in kg
POSITION_REST = 14  # 3 columns, m: what rounding took from POSITION, to be given back
SUBSTEP_COLUMNS = 17  # how many columns, all those above, every substep reads
VELOCITY = 17  # 3 columns, m/s; valid between segments only
AFFINE = 20  # 9 columns, APIC matrix C row by row, 1/s; valid between segments only
LOAD = 29  # row of the kicks: which loads act on the particle
INDEX = 30  # number n of the particle in the body, as int32 bits; ~n for padding that copies it
LAW_COLUMNS = 31  # from here on each law has its own: its parameters, then its state (``Law.column_count``)

SCATTER_ONLY, FUSED, GATHER_ONLY = 0, 1, 2
"""What a particle pass does: begin a segment, a substep in its middle, or end it."""

_OPTIONS: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "boundscheck": False,
    "nogil": True,
    "no_cfunc_wrapper": True,  # compiled faster; nobody calls kernels from C
}
strict_kernel: Any = numba.njit(**_OPTIONS)
"""Decorator of a compiled, cached kernel in which NaN and infinity keep their meaning."""
kernel: Any = numba.njit(fastmath=True, **_OPTIONS)
"""Decorator of a compiled, cached kernel."""
_INNER_OPTIONS: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True}
inner_kernel: Any = numba.njit(fastmath=True, **_INNER_OPTIONS)
"""The same for kernels that only other kernels call, compiled faster."""
parallel_kernel: Any = numba.njit(parallel=True, fastmath=True, **_OPTIONS)
"""Decorator of a compiled, cached kernel whose ``prange`` loops run on all threads."""
