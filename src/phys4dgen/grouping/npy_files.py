"""Arrays from files of unknown origin: nothing is unpickled, and nothing is read that is larger than it may be."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.formats.npy_header import NpyHeaderError, read_npy_header

__all__ = ["read_npy", "read_npz"]

_ARCHIVE_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, struct.error, UnicodeDecodeError),
    *(NotImplementedError, EOFError, RuntimeError),
)


def read_npy(path: Path, name: str, max_bytes: int) -> NDArray[Any]:
    """The array of a .npy file.

    Args:
        path: the file.
        name: what it holds, for errors.
        max_bytes: size of its content at most.

    Raises:
        FormatError: it cannot be read, is no such file, or too large.
    """
    try:
        with path.open("rb") as file:
            return _read_array(path, file, name, max_bytes)
    except OSError as error:
        raise FormatError(f"{path}: cannot read the labels: {error.strerror or error}.") from error


def read_npz(path: Path, required: str, max_bytes: Mapping[str, int]) -> dict[str, NDArray[Any]]:
    """Those arrays of a .npz file that ``max_bytes`` names; others are not looked at.

    Args:
        path: the file.
        required: the array without which the file is of no use.
        max_bytes: by name, size of the content at most.

    Raises:
        FormatError: it cannot be read, is damaged, lacks ``required``, or an array is too large.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = archive.namelist()
            if f"{required}.npy" not in members:
                held = ", ".join(ascii(name.removesuffix(".npy"))[1:-1] for name in members[:8]) or "nothing"
                raise FormatError(f"{path}: expected an array called {required}, got {held}; np.savez({required}=...).")
            arrays: dict[str, NDArray[Any]] = {}
            for name, limit in max_bytes.items():
                if f"{name}.npy" in members:
                    with archive.open(f"{name}.npy") as member:
                        arrays[name] = _read_array(path, member, name, limit)
            return arrays
    except OSError as error:
        raise FormatError(f"{path}: cannot read the labels: {error.strerror or error}.") from error
    except _ARCHIVE_ERRORS as error:
        raise FormatError(f"{path}: expected a NumPy .npz archive, got a damaged one ({error}).") from error


def _read_array(path: Path, file: Any, name: str, max_bytes: int) -> NDArray[Any]:
    """One array of at most ``max_bytes``."""
    try:
        shape, fortran_order, dtype = read_npy_header(file)
    except NpyHeaderError as error:
        raise FormatError(f"{path}: {name} is not a NumPy array ({error}); save it with numpy.save.") from error
    if min(shape, default=0) < 0:
        raise FormatError(f"{path}: {name} has a negative length in its shape {shape}; save it with numpy.save.")
    size = dtype.itemsize
    for length in shape:
        size *= int(length)
    if dtype.hasobject:
        raise FormatError(f"{path}: {name} holds Python objects, which are not read; save plain numbers or text.")
    if size > max_bytes:
        raise FormatError(
            f"{path}: {name} has shape {shape} of {dtype}, {size:,} bytes; at most {max_bytes:,} fit this input."
        )
    if size == 0:
        raise FormatError(f"{path}: {name} is empty, of shape {shape} and type {dtype}; give one value per Gaussian.")
    content = file.read(size)
    if len(content) != size:
        raise FormatError(f"{path}: {name} is cut short; {size:,} bytes announced, {len(content):,} found.")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")
