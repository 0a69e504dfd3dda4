"""What a splat file holds once read, and the steps that every codec shares: checking a path, cleaning raw values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.types import Gaussians

__all__ = [
    "LARGEST_VALUE",
    "SMALLEST_SCALE",
    "SplatFile",
    "existing_file",
    "raise_scales",
    "refuse_invalid_rows",
    "unit_quaternions",
]

LARGEST_VALUE = 1e18
"""Squares of anything larger leave float32, in which everything downstream computes."""

SMALLEST_SCALE = 1e-18
"""Standard deviations below it are raised to it, for the same reason."""


@dataclass(frozen=True, eq=False)
class SplatFile:
    """A splat file in memory.

    Attributes:
        gaussians: the Gaussians, in the file's order and coordinates.
        layout: one line for people, such as "PLY, binary_little_endian, 62 properties".
        extra: further scalar columns by name (labels, weights ...), shape [N] each, in the file's own type.
        notes: what the reader had to repair, one sentence each.
    """

    gaussians: Gaussians
    layout: str
    extra: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]


def existing_file(path: Path | str) -> Path:
    """Return ``path`` if it is a regular file with content.

    Raises:
        FormatError: missing, a folder, a device or empty.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise FormatError(f"{path}: expected a splat file, got a folder; give one of the files in it.")
        if not path.exists():
            raise FormatError(f"{path}: there is no such file; check the spelling and the folder.")
        if not path.is_file():
            raise FormatError(f"{path}: expected a regular file, got a device or pipe; save it to disk first.")
        if path.stat().st_size == 0:
            raise FormatError(f"{path}: the file is empty (0 bytes); export or download it again.")
    except (OSError, ValueError) as error:  # no permission, a name that is too long, a zero byte in the name
        raise FormatError(
            f"{str(path)[:200]!r}: the file cannot be reached ({error}); check path and rights."
        ) from error
    return path


def refuse_invalid_rows(path: Path, columns: Sequence[tuple[Sequence[str], NDArray[Any], float, float]]) -> None:
    """Raise if any value leaves its range; each entry is (names of the C columns, values [N, C], lowest, highest).

    Raises:
        FormatError: NaN or out of range; says how many Gaussians are affected and where the first one is.
    """
    # NaN makes both reductions NaN and so fails the comparison; a good file costs no temporary array.
    if all(low <= values.min() and values.max() <= high for _, values, low, high in columns):
        return
    names = [name for group, _, _, _ in columns for name in group]
    values = np.concatenate([values for _, values, _, _ in columns], axis=1)
    invalid = ~np.concatenate([(low <= values) & (values <= high) for _, values, low, high in columns], axis=1)
    rows = np.flatnonzero(invalid.any(axis=1))
    column = int(np.argmax(invalid[rows[0]]))
    raise FormatError(
        f"{path}: {len(rows)} of {len(values)} Gaussians hold values that are not usable numbers, the first is "
        f"{names[column]} = {values[rows[0], column]:g} of Gaussian {rows[0]}; remove these rows or export it again."
    )


def unit_quaternions(quats_wxyz: NDArray[Any]) -> tuple[NDArray[np.float32], list[str]]:
    """Normalise quaternions [N, 4]; those of zero length become the identity. Returns them and the notes."""
    wide = quats_wxyz.astype(np.float64)  # float32 squares of legal file values can overflow
    norms = np.sqrt(np.einsum("ij,ij->i", wide, wide))
    # A float32 quaternion that is as near to unit length as it can be stays as it is: files must read back to the bit.
    norms[np.abs(norms - 1) < 3e-7] = 1.0
    zero = norms < 1e-18
    if not zero.any():
        return (wide / norms[:, None]).astype(np.float32), []
    wide[zero] = (1.0, 0.0, 0.0, 0.0)
    norms[zero] = 1.0
    note = f"{int(zero.sum())} of {len(wide)} quaternions had zero length and were taken as no rotation."
    return (wide / norms[:, None]).astype(np.float32), [note]


def raise_scales(scales: NDArray[np.float32]) -> tuple[NDArray[np.float32], list[str]]:
    """Raise scales [N, 3] that are zero or too small to square in float32. Returns them and the notes."""
    tiny = scales < SMALLEST_SCALE
    if not tiny.any():
        return scales, []
    note = (
        f"{int(tiny.any(axis=1).sum())} of {len(scales)} Gaussians had a scale of zero, raised to {SMALLEST_SCALE:g}."
    )
    return np.where(tiny, np.float32(SMALLEST_SCALE), scales), [note]
