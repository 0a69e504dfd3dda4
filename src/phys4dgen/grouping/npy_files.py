"""Arrays from files of unknown origin: nothing is unpickled, and nothing is read that is larger than it may be."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from phys4dgen.errors import FormatError

__all__ = ["read_npy", "read_npz"]


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
                held = ", ".join(name.removesuffix(".npy") for name in members[:8]) or "nothing"
                raise FormatError(f"{path}: expected an array called {required}, got {held}; np.savez({required}=...).")
            arrays: dict[str, NDArray[Any]] = {}
            for name, limit in max_bytes.items():
                if f"{name}.npy" in members:
                    with archive.open(f"{name}.npy") as member:
                        arrays[name] = _read_array(path, member, name, limit)
            return arrays
    except OSError as error:
        raise FormatError(f"{path}: cannot read the labels: {error.strerror or error}.") from error
    except (zipfile.BadZipFile, NotImplementedError, EOFError, RuntimeError) as error:
        raise FormatError(f"{path}: expected a NumPy .npz archive, got a damaged one ({error}).") from error


def _read_array(path: Path, file: Any, name: str, max_bytes: int) -> NDArray[Any]:
    """One array of at most ``max_bytes``."""
    try:
        version = npy_format.read_magic(file)
        header = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, fortran_order, dtype = header(file)
    except ValueError as error:
        raise FormatError(f"{path}: {name} is not a NumPy array: {error}.") from error
    size = dtype.itemsize
    for length in shape:
        size *= int(length)
    if dtype.hasobject:
        raise FormatError(f"{path}: {name} holds Python objects, which are not read; save plain numbers or text.")
    if size > max_bytes:
        raise FormatError(
            f"{path}: {name} has shape {shape} of {dtype}, {size:,} bytes; at most {max_bytes:,} fit this input."
        )
    content = file.read(size)
    if len(content) != size:
        raise FormatError(f"{path}: {name} is cut short; {size:,} bytes announced, {len(content):,} found.")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")
