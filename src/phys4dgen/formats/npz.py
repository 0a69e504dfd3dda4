"""Named arrays in a ``.npz`` file, written whole."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.formats.atomic import atomic_path

__all__ = ["save_npz"]


def save_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays atomically, without compression: they are read more often than they are sent.

    They are put together in memory: an archive that is interrupted amid a file complains when it is thrown away.
    """
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    with atomic_path(path) as temporary:
        temporary.write_bytes(buffer.getbuffer())
