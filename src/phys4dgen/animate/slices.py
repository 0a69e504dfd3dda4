"""Running a kernel over slices of its work on several threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numba import get_num_threads

__all__ = ["run_slices"]


def run_slices(kernel: Callable[..., None], *arguments: Any, threads: int | None) -> None:
    """Call ``kernel(part, parts, *arguments)`` for every part, each on a thread of its own.

    Plain threads on kernels that release the GIL: they compile in a fraction of the time of Numba's own parallel
    loops and have no barrier at which a loaded machine would stall. ``threads=None`` takes Numba's thread count.
    """
    parts = get_num_threads() if threads is None else threads
    if parts == 1:
        kernel(0, 1, *arguments)
        return
    with ThreadPoolExecutor(parts) as pool:
        for future in [pool.submit(kernel, part, parts, *arguments) for part in range(parts)]:
            future.result()
