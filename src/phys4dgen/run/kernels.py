"""Numba's cache of this package's compiled kernels."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["compiled_kernels", "kernel_cache_is_writable", "simulator_is_compiled"]

_PACKAGE = Path(__file__).parents[1]


def compiled_kernels() -> int:
    """How many kernels are cached, beside the sources or where NUMBA_CACHE_DIR says."""
    return sum(1 for place in _places() for _ in place.rglob("*.nbi"))


def simulator_is_compiled() -> bool:
    """Whether the largest kernel is cached, so that a run starts at once."""
    return any(next(place.rglob("step.advance-*.nbi"), None) for place in _places())


def kernel_cache_is_writable() -> bool:
    """Whether new kernels can be cached."""
    return any(os.access(place, os.W_OK) for place in _places())


def _places() -> Iterator[Path]:
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    for place in (Path(chosen), _PACKAGE) if chosen else (_PACKAGE,):
        if place.is_dir():
            yield place
