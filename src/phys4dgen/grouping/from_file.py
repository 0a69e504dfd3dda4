"""Parts that a user brings: one label per Gaussian from a .npy or .npz file, or one part for everything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError, StageError
from phys4dgen.grouping.npy_files import read_npy, read_npz
from phys4dgen.types import Parts

__all__ = ["MAX_LABELS", "parts_from_file", "rename_parts", "single_part"]

MAX_LABELS = 256
"""A file with more different labels is taken for something else."""

_MAX_NAME_LENGTH = 64
_MAX_NAMES_BYTES = 1 << 20


def single_part(gaussian_count: int) -> Parts:
    """The whole object as one part (``grouping.backend: none``)."""
    return Parts(labels=np.zeros(gaussian_count, np.int32), names=("part_0",), backend="none")


def parts_from_file(path: Path | str, gaussian_count: int, *, rows: NDArray[np.int64] | None = None) -> Parts:
    """Read one label per Gaussian (``grouping.backend: file``).

    A ``.npy`` file holds the labels; a ``.npz`` file holds them under ``labels`` and may name the parts under
    ``names``, in ascending order of the labels or one name for each number from 0 on. Labels may have gaps; they are
    renumbered 0 .. G-1 in ascending order, which keeps the order of the file.

    Args:
        path: the file.
        gaussian_count: N, in the input's order.
        rows: those that are the object, [M]; others may bear any label. None: all.

    Raises:
        FormatError: the file is no such file, or its labels or names do not fit the input.
    """
    path = Path(path)
    arrays = _read_arrays(path, gaussian_count)
    labels = arrays["labels"]
    if labels.shape != (gaussian_count,):
        raise FormatError(
            f"{path}: labels must hold one whole number for each of the input's {gaussian_count} Gaussians, got shape "
            f"{labels.shape}; save them in the order of the input file."
        )
    if labels.dtype.kind not in "iu":
        raise FormatError(
            f"{path}: labels must be whole numbers (int32), got {labels.dtype}; convert with labels.astype('int32')."
        )
    numbers = np.unique(labels[labels >= 0])
    labels = labels if rows is None else labels[rows]
    if labels.min() < 0:
        raise FormatError(
            f"{path}: labels must be 0 or more, got {int(labels.min())} at index {int(labels.argmin())}; give every "
            "Gaussian a part."
        )
    values, dense = np.unique(labels, return_inverse=True)
    if len(values) > MAX_LABELS:
        raise FormatError(f"{path}: labels must hold at most {MAX_LABELS} different parts, got {len(values)}.")
    names = _names(path, arrays.get("names"), numbers)
    names = tuple(names[place] for place in np.searchsorted(numbers, values))
    return Parts(labels=dense.astype(np.int32), names=names, backend="file")


def rename_parts(parts: Parts, names: Mapping[int, str]) -> Parts:
    """The same parts with other names.

    Args:
        parts: the parts.
        names: part number -> new name; numbers not given keep their name.

    Raises:
        StageError: there is no part of that number, or two parts would have one name.
    """
    unknown = sorted(number for number in names if not 0 <= number < parts.count)
    if unknown:
        raise StageError(
            f"grouping.names: there is no part {unknown[0]}; the parts are 0 to {parts.count - 1}, numbered from the "
            "ground up."
        )
    renamed = tuple(names.get(number, name) for number, name in enumerate(parts.names))
    twice = [name for name in renamed if renamed.count(name) > 1]
    if twice:
        raise StageError(f"grouping.names: every part needs its own name, but two would be called '{twice[0]}'.")
    return replace(parts, names=renamed)


def _names(path: Path, given: NDArray[Any] | None, values: NDArray[Any]) -> tuple[str, ...]:
    if given is None:
        return tuple(f"part_{i}" for i in range(len(values)))
    if given.dtype.kind != "U" or given.ndim != 1:
        raise FormatError(f"{path}: names must be a list of text, got {given.dtype} of shape {given.shape}.")
    if len(given) == len(values):
        chosen = given
    elif len(given) == int(values[-1]) + 1:  # one for every number, used or not
        chosen = given[values]
    else:
        raise FormatError(
            f"{path}: names must name each of the {len(values)} parts, or each number from 0 to {int(values[-1])}, got "
            f"{len(given)} names."
        )
    names = tuple(str(name).strip() for name in chosen)
    bad = [name for name in names if not (0 < len(name) <= _MAX_NAME_LENGTH and name.isprintable())]
    if bad:
        raise FormatError(
            f"{path}: names must be printable text of 1 to {_MAX_NAME_LENGTH} characters, got {bad[0][:80]!r}."
        )
    if len(set(names)) != len(names):
        raise FormatError(f"{path}: names must differ, got {list(names)}.")
    return names


def _read_arrays(path: Path, gaussian_count: int) -> dict[str, NDArray[Any]]:
    """``labels`` and, where present, ``names``; sizes are checked against the headers before anything is read."""
    suffix = path.suffix.lower()
    limit = 8 * gaussian_count
    if suffix == ".npy":
        return {"labels": read_npy(path, "labels", limit)}
    if suffix == ".npz":
        return read_npz(path, "labels", {"labels": limit, "names": _MAX_NAMES_BYTES})
    raise FormatError(f"{path}: labels are read from .npy or .npz files, got '{path.suffix}'.")
