"""A slow, plain PLY writer made with struct alone, so that the reader is not tested against its own ideas."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np

STRUCT_CODES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip


def inria_columns(n: int, *, degree: int = 0, normals: bool = True, seed: int = 0) -> dict[str, np.ndarray]:
    """Raw file values of n Gaussians in INRIA's order: logits, log scales, quaternions that are not of unit length."""
    rng = np.random.default_rng(seed)
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals else []) + ["f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * ((degree + 1) ** 2 - 1))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    return {name: rng.normal(size=n).astype(np.float32).astype(np.float64) for name in names}


def ply_bytes(
    columns: Mapping[str, Sequence[float] | np.ndarray],
    *,
    types: Mapping[str, str] | None = None,
    encoding: str = "binary_little_endian",
    header_lines: Sequence[str] = (),
    before: tuple[str, bytes] = ("", b""),
    after: tuple[str, bytes] = ("", b""),
    newline: str = "\n",
    count: object = None,
) -> bytes:
    """A PLY file.

    Args:
        columns: values per property of ``vertex``, in file order.
        types: PLY type per property where it is not ``float``.
        encoding: the word of the format line.
        header_lines: comments and the like, put behind the format line.
        before: header text and body of elements in front of ``vertex``.
        after: the same for elements behind it.
        newline: line end of the header.
        count: what the header claims instead of the true number of rows.
    """
    types = types or {}
    kinds = [types.get(name, "float") for name in columns]
    rows = list(zip(*columns.values(), strict=True))
    lines = ["ply", f"format {encoding} 1.0", *header_lines, *before[0].splitlines()]
    lines += [f"element vertex {len(rows) if count is None else count}"]
    lines += [f"property {kind} {name}" for kind, name in zip(kinds, columns, strict=True)]
    lines += [*after[0].splitlines(), "end_header", ""]
    integer = [STRUCT_CODES[kind] not in "fd" for kind in kinds]
    typed = [[int(v) if whole else float(v) for v, whole in zip(row, integer, strict=True)] for row in rows]
    if encoding == "ascii":
        body = "".join(" ".join(map(repr, row)) + "\n" for row in typed).encode()
    else:
        sign = "<" if encoding == "binary_little_endian" else ">"
        layout = sign + "".join(STRUCT_CODES[kind] for kind in kinds)
        body = b"".join(struct.pack(layout, *row) for row in typed)
    return newline.join(lines).encode() + before[1] + body + after[1]
