"""Validation shared by the core types: one wording for every array that is not what it should be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

__all__ = ["checked_array", "frozen"]


def checked_array(
    value: Any,
    name: str,
    shape: tuple[int | None, ...],
    dtype: DTypeLike,
    *,
    finite: bool = True,
) -> NDArray[Any]:
    """Return ``value`` as a read-only C-contiguous array of ``dtype`` and ``shape`` (None matches any length).

    Raises:
        ValueError: the shape does not match, a number does not fit the type, or a float array holds NaN or infinity;
            names the argument.
    """
    try:
        array = np.ascontiguousarray(value, dtype=dtype)
    except OverflowError as error:  # a whole number beyond every float
        raise ValueError(f"{name}: expected numbers of type {np.dtype(dtype)}: {error}.") from error
    matches = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not matches:
        wanted = tuple("any" if want is None else want for want in shape)
        raise ValueError(f"{name}: expected shape {wanted}, got {array.shape}.")
    if finite and array.dtype.kind == "f" and not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"{name}: expected finite numbers, got {array[tuple(bad)]} at index {tuple(map(int, bad))}.")
    return frozen(array)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view, so that a frozen dataclass is frozen to its last element."""
    view = array.view()
    view.flags.writeable = False
    return view
