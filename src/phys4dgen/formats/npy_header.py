"""The header of a .npy file of unknown origin: NumPy's reader, with one kind of error and no warnings."""

from __future__ import annotations

import tokenize
import warnings
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format

__all__ = ["NpyHeaderError", "read_npy_header"]

_FAULTS = (
    *(ValueError, SyntaxError, tokenize.TokenError, RecursionError, MemoryError),
    *(DeprecationWarning, FutureWarning),  # of names of types that nobody writes any more
)


class NpyHeaderError(ValueError):
    """The header is not what it should be."""


def read_npy_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether in Fortran's order, and type of the array that follows; the shape may be negative or too large.

    Raises:
        NpyHeaderError: damaged, or of another version than 1.0; later ones announce headers of up to 4 GB.
    """
    try:
        version = npy_format.read_magic(file)
        if version == (1, 0):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", UserWarning)  # files of Python 2 are read like others
                return npy_format.read_array_header_1_0(file)
    except _FAULTS as error:
        raise NpyHeaderError("its header is damaged") from error
    raise NpyHeaderError(f"it is of version {version[0]}.{version[1]}, expected 1.0")
