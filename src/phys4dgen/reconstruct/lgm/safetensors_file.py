"""The safetensors format: eight bytes of length, a JSON header, and the numbers; nothing in it is ever executed.

Everything that the header promises is compared with the size of the file and with what the network needs before memory
is taken for it. Format: https://github.com/huggingface/safetensors (README, "Format").
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError, did_you_mean

__all__ = ["StoredTensor", "read_tensor", "stored_tensors"]

MAX_HEADER_BYTES = 16 * 2**20
NUMBERS: Mapping[str, str] = {"F16": "<f2", "F32": "<f4"}
_PICKLES = (b"PK\x03\x04", b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
"""How files of torch.save and of pickle begin."""


@dataclass(frozen=True)
class StoredTensor:
    """Where a tensor lies.

    Attributes:
        shape: of the tensor.
        dtype: NumPy's name of its numbers.
        offset: of its first byte in the file.
    """

    shape: tuple[int, ...]
    dtype: str
    offset: int

    @property
    def size_bytes(self) -> int:
        """In the file."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


def stored_tensors(path: Path, expected: Mapping[str, tuple[int, ...]], *, network: str) -> dict[str, StoredTensor]:
    """Where each expected tensor lies; keys, shapes and the file's length must be exactly what the network needs.

    Args:
        path: the checkpoint.
        expected: shape by key.
        network: what the checkpoint is for, for messages.

    Raises:
        FormatError: a pickle, not safetensors, cut off, of another network or in another number format.
    """
    if not path.is_file():
        raise FormatError(f"{path}: there is no such checkpoint; expected the .safetensors file of {network}.")
    size = path.stat().st_size
    entries, first = _header(path, size, network)
    missing = [key for key in expected if key not in entries]
    unexpected = [key for key in entries if key not in expected]
    if missing or unexpected:
        example = missing[0] if missing else unexpected[0]
        hint = did_you_mean(missing[0], unexpected) if missing else ""
        raise FormatError(
            f"{path}: not a checkpoint of {network}: {len(missing)} of its {len(expected)} tensors are missing and "
            f"{len(unexpected)} are unknown, such as '{example[:80]}'.{hint}"
        )
    tensors = {key: _entry(path, key, entries[key], first) for key in expected}
    for key, shape in expected.items():
        if tensors[key].shape != shape:
            raise FormatError(
                f"{path}: not a checkpoint of {network}: '{key}' has shape {tensors[key].shape}, expected {shape}."
            )
    _refuse_gaps(path, tensors, first, size)
    return tensors


def read_tensor(path: Path, tensor: StoredTensor) -> NDArray[np.float32]:
    """The numbers of a tensor.

    Raises:
        FormatError: they are not finite.
    """
    count = math.prod(tensor.shape)
    values = np.fromfile(path, np.dtype(tensor.dtype), count, offset=tensor.offset)
    if len(values) != count or not np.isfinite(values).all():
        raise FormatError(f"{path}: a tensor of the checkpoint is cut off or not finite; download the file again.")
    return values.astype(np.float32).reshape(tensor.shape)


def _header(path: Path, size: int, network: str) -> tuple[dict[str, Any], int]:
    """The entries of the JSON header, and where the numbers begin."""
    with path.open("rb") as stream:
        start = stream.read(8)
        if start.startswith(_PICKLES):
            raise FormatError(
                f"{path}: this checkpoint is a pickle, which can run any program when it is opened, so it is not "
                f"opened; get the .safetensors file of {network}."
            )
        length = int.from_bytes(start, "little")
        if len(start) < 8 or not 2 <= length <= min(MAX_HEADER_BYTES, size - 8):
            raise FormatError(f"{path}: not a safetensors file, or cut off in its header; get {network} again.")
        text = stream.read(length)
    try:
        header = json.loads(text.decode("utf-8"), object_pairs_hook=_without_repeats)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: the header of the checkpoint is damaged ({error}); download it again.") from error
    if not isinstance(header, dict):
        raise FormatError(f"{path}: the header of the checkpoint is no JSON object; download it again.")
    header.pop("__metadata__", None)
    return header, 8 + length


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries = dict(pairs)
    if len(entries) != len(pairs):
        raise ValueError("a key stands twice")
    return entries


def _entry(path: Path, key: str, entry: Any, first: int) -> StoredTensor:
    """One entry of the header: number format, shape and place, all checked."""
    damaged = FormatError(f"{path}: the entry of '{key}' in the checkpoint's header is damaged; download it again.")
    if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "data_offsets"}:
        raise damaged
    shape, offsets = entry["shape"], entry["data_offsets"]
    if not (_whole_numbers(shape) and _whole_numbers(offsets) and len(offsets) == 2):
        raise damaged
    if not isinstance(entry["dtype"], str) or entry["dtype"] not in NUMBERS:
        raise FormatError(
            f"{path}: '{key}' holds numbers of type {str(entry['dtype'])[:20]}, expected {' or '.join(NUMBERS)}; "
            "convert the checkpoint."
        )
    tensor = StoredTensor(tuple(shape), NUMBERS[entry["dtype"]], first + offsets[0])
    if offsets[1] - offsets[0] != tensor.size_bytes:
        raise damaged
    return tensor


def _whole_numbers(values: Any) -> bool:
    return isinstance(values, list) and all(type(value) is int and 0 <= value < 2**48 for value in values)


def _refuse_gaps(path: Path, tensors: Mapping[str, StoredTensor], first: int, size: int) -> None:
    """The tensors must fill the file from the header to its end, without a gap and without sharing bytes."""
    place = first
    for tensor in sorted(tensors.values(), key=lambda tensor: tensor.offset):
        if tensor.offset != place:
            raise FormatError(f"{path}: tensors overlap or leave gaps in the checkpoint; download it again.")
        place += tensor.size_bytes
    if place != size:
        raise FormatError(
            f"{path}: the checkpoint should be {place:,} bytes long and is {size:,}; it was not downloaded completely, "
            "get it again."
        )
