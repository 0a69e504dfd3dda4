"""The header of a PLY file, parsed with every number bounded before it is used.

Reference: Greg Turk, "The PLY Polygon File Format", 1994; type aliases (float32, uint8 ...) as later tools write them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from phys4dgen.errors import FormatError, did_you_mean

__all__ = ["PlyElement", "PlyHeader", "PlyProperty", "read_ply_header"]

MAX_HEADER_BYTES = 256 * 1024
MAX_COUNT_DIGITS = 15

SCALAR_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}


@dataclass(frozen=True)
class PlyProperty:
    """One column: its name, NumPy type without byte order, and the type of its length if it is a list."""

    name: str
    type_code: str
    list_count_code: str | None = None


@dataclass(frozen=True)
class PlyElement:
    """One table of the file: name, number of rows and columns."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    @property
    def has_lists(self) -> bool:
        """True if rows differ in length."""
        return any(column.list_count_code is not None for column in self.properties)

    def row_dtype(self, byte_order: str) -> np.dtype:
        """Structured type of one row of an element without lists."""
        return np.dtype([(column.name, byte_order + column.type_code) for column in self.properties])


@dataclass(frozen=True)
class PlyHeader:
    """The tables of a PLY file in order, how they are encoded and where the first begins.

    Attributes:
        encoding: "binary_little_endian", "binary_big_endian" or "ascii".
        elements: the tables.
        data_offset: bytes from the start of the file to the first row.
    """

    encoding: str
    elements: tuple[PlyElement, ...]
    data_offset: int

    @property
    def byte_order(self) -> str:
        """NumPy's sign for the byte order."""
        return BYTE_ORDERS[self.encoding]


def read_ply_header(stream: BinaryIO, path: Path) -> PlyHeader:
    """Parse the header; ``stream`` stands at the start of the file and is left at the first byte of data.

    Raises:
        FormatError: not a PLY, no end within MAX_HEADER_BYTES, or a line that no PLY may hold.
    """
    if stream.readline(8).strip() != b"ply":
        raise FormatError(f"{path}: expected a PLY file that starts with the line 'ply'; is it of another format?")
    encoding: str | None = None
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    while True:
        raw = stream.readline(MAX_HEADER_BYTES)
        if stream.tell() > MAX_HEADER_BYTES:
            raise FormatError(
                f"{path}: the PLY header has no 'end_header' line in its first {MAX_HEADER_BYTES // 1024} KiB; "
                "the file is damaged or not a splat."
            )
        if not raw.endswith(b"\n"):
            raise FormatError(f"{path}: the PLY header ends without 'end_header'; the file is cut off, get it again.")
        words = raw.decode("latin-1").split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words == ["end_header"]:
            break
        if words[0] == "format" and len(words) == 3 and words[1] in BYTE_ORDERS:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3:
            if any(words[1] == name for name, _, _ in elements):
                raise FormatError(f"{path}: the PLY header declares element {shown(words[1])} twice; export it again.")
            elements.append((words[1], parse_count(words, path), []))
        elif words[0] == "property" and elements:
            elements[-1][2].append(parse_property(words, path))
        else:
            raise FormatError(
                f"{path}: the PLY header line {shown(' '.join(words))} is no valid format, element or property line; "
                "export the file again as binary_little_endian."
            )
    if encoding is None:
        raise FormatError(f"{path}: the PLY header has no 'format' line; export it as binary_little_endian 1.0.")
    for name, _, columns in elements:
        repeated = len(columns) - len({column.name for column in columns})
        if repeated:
            raise FormatError(f"{path}: element {shown(name)} declares {repeated} properties twice; export it again.")
    return PlyHeader(
        encoding=encoding,
        elements=tuple(PlyElement(name, count, tuple(columns)) for name, count, columns in elements),
        data_offset=stream.tell(),
    )


def parse_count(words: list[str], path: Path) -> int:
    """Row count of an ``element`` line: plain digits only (``int`` would accept "-1", "1_0" and other scripts)."""
    digits = words[2]
    if not (digits.isascii() and digits.isdigit() and len(digits) <= MAX_COUNT_DIGITS):
        raise FormatError(
            f"{path}: element {shown(words[1])} expects a number of rows from 0 up, got {shown(digits)}; "
            "the header is damaged, export the file again."
        )
    return int(digits)


def parse_property(words: list[str], path: Path) -> PlyProperty:
    """Column of a ``property TYPE NAME`` or ``property list COUNT_TYPE TYPE NAME`` line."""
    is_list = len(words) == 5 and words[1] == "list"
    if not is_list and len(words) != 3:
        raise FormatError(f"{path}: expected 'property TYPE NAME' in the PLY header, got {shown(' '.join(words))}.")
    for word in words[2:4] if is_list else words[1:2]:
        if word not in SCALAR_TYPES:
            raise FormatError(
                f"{path}: property {shown(words[-1])} has the unknown type {shown(word)}, expected float, double, "
                f"(u)char, (u)short, (u)int or float32, int8 ....{did_you_mean(word, SCALAR_TYPES)}"
            )
    if not is_list:
        return PlyProperty(words[2], SCALAR_TYPES[words[1]])
    count_code = SCALAR_TYPES[words[2]]
    if count_code.startswith("f"):
        raise FormatError(f"{path}: list {shown(words[-1])} counts its items in {words[2]}, expected an integer type.")
    return PlyProperty(words[4], SCALAR_TYPES[words[3]], count_code)


def shown(text: str) -> str:
    """Text from a file, quoted, safe to print and short."""
    return ascii(text if len(text) <= 40 else text[:40] + "...")
