"""PlayCanvas compressed PLY (SuperSplat's ``.compressed.ply``): 16 bytes per Gaussian in chunks of 256.

Element ``chunk`` holds the float bounds of 256 Gaussians: position, natural logarithm of scale and, in newer files,
colour. Element ``vertex`` holds four words per Gaussian, each field a share of the way between its bounds:
``packed_position`` and ``packed_scale`` 11-10-11 bits x, y, z; ``packed_color`` 8-8-8-8 bits red, green, blue (0.5 +
SH_C0 * f_dc) and opacity (linear, not a logit); ``packed_rotation`` 2-10-10-10 bits: which of w, x, y, z is largest
and left out, then the others in that order, from -1/sqrt(2) to 1/sqrt(2). Element ``sh`` holds ``f_rest`` in the
INRIA order, a byte from -4 to 4 each. Reference: PlayCanvas engine, ``gsplat-compressed-data.js``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.formats.ply_header import PlyElement, PlyHeader
from phys4dgen.formats.splat_file import (
    LARGEST_VALUE,
    SplatFile,
    raise_scales,
    refuse_invalid_rows,
    unit_quaternions,
)
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["is_compressed", "read_compressed_ply"]

CHUNK_ROWS = 256
LARGEST_LOG_SCALE = 41.0  # as in ply.py: squares of larger scales leave float32
SH_RANGE = 4.0

OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""The components that are kept of a quaternion, by the number of the one that is left out."""

PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")


def bound_names(fields: Sequence[str]) -> tuple[str, ...]:
    """Names of the lower bounds, then of the upper ones."""
    return tuple(f"{end}_{field}" for end in ("min", "max") for field in fields)


POSITION_BOUNDS = bound_names(("x", "y", "z"))
SCALE_BOUNDS = bound_names(("scale_x", "scale_y", "scale_z"))
COLOR_BOUNDS = bound_names(("r", "g", "b"))


def is_compressed(header: PlyHeader) -> bool:
    """Whether the vertices of a PLY are packed in this way."""
    return any(e.name == "vertex" and "packed_position" in {c.name for c in e.properties} for e in header.elements)


def read_compressed_ply(stream: BinaryIO, header: PlyHeader, path: Path) -> SplatFile:
    """Read the body of a compressed PLY; SH degree 0 to 3.

    Args:
        stream: stands at the first byte of data.
        header: of the file, for which ``is_compressed`` holds.
        path: of the file, for its size and for errors.

    Raises:
        FormatError: elements missing, of other types or of counts that do not fit, cut off, or unusable numbers.
    """
    chunk, vertex, sh = checked_elements(header, path)
    rest = 0 if sh is None else len(sh.properties)
    refuse_short_body(stream, header, path)
    bounds = np.fromfile(stream, chunk.row_dtype(header.byte_order), chunk.count)
    packed = np.fromfile(stream, vertex.row_dtype(header.byte_order), vertex.count)
    n = vertex.count
    lower, upper = bounds_of(bounds, POSITION_BOUNDS, n)
    means = between(lower, upper, unpacked(packed["packed_position"], (11, 10, 11)))
    lower, upper = bounds_of(bounds, SCALE_BOUNDS, n)
    log_scales = between(lower, upper, unpacked(packed["packed_scale"], (11, 10, 11)))
    rgba = unpacked(packed["packed_color"], (8, 8, 8, 8))
    rgb = rgba[:, :3]
    if set(COLOR_BOUNDS) <= set(bounds.dtype.names or ()):
        rgb = between(*bounds_of(bounds, COLOR_BOUNDS, n), rgb)
    coefficients = np.zeros((n, 1 + rest // 3, 3), np.float32)
    with np.errstate(over="ignore"):  # bounds beyond the largest value are refused below
        coefficients[:, 0] = (rgb - np.float32(0.5)) / np.float32(SH_C0)
    if rest:
        levels = np.fromfile(stream, np.uint8, n * rest).reshape(n, 3, rest // 3)
        coefficients[:, 1:] = levels.transpose(0, 2, 1) * np.float32(2 * SH_RANGE / 255) - np.float32(SH_RANGE)
    refuse_invalid_rows(
        path,
        [
            (("x", "y", "z"), means, -LARGEST_VALUE, LARGEST_VALUE),
            (("scale_x", "scale_y", "scale_z"), log_scales, -np.inf, LARGEST_LOG_SCALE),
            (("r", "g", "b"), rgb, -LARGEST_VALUE, LARGEST_VALUE),
        ],
    )
    scales, scale_notes = raise_scales(np.exp(log_scales))
    quats_wxyz, quat_notes = unit_quaternions(unpacked_quats(packed["packed_rotation"]))
    return SplatFile(
        gaussians=Gaussians(
            means=means, quats_wxyz=quats_wxyz, scales=scales, opacities=rgba[:, 3].copy(), sh=coefficients
        ),
        layout=f"PLY, PlayCanvas compressed, {header.encoding}",
        extra={},
        notes=(*quat_notes, *scale_notes),
    )


def checked_elements(header: PlyHeader, path: Path) -> tuple[PlyElement, PlyElement, PlyElement | None]:
    """The elements chunk, vertex and, where there is one, sh, of the order, columns and counts that the format has."""
    if header.encoding == "ascii":
        raise FormatError(f"{path}: expected a compressed PLY in binary, got ascii; export it again.")
    names = [element.name for element in header.elements]
    if names not in (["chunk", "vertex"], ["chunk", "vertex", "sh"]):
        raise FormatError(
            f"{path}: expected a compressed PLY of the elements chunk, vertex and perhaps sh, got "
            f"{ascii(', '.join(names))[:80]}; export it again."
        )
    chunk, vertex = header.elements[:2]
    sh = header.elements[2] if len(names) == 3 else None
    required = {*POSITION_BOUNDS, *SCALE_BOUNDS}
    floats = {column.name for column in chunk.properties if column.type_code == "f4"}
    words = [(column.name, column.type_code) for column in vertex.properties]
    if not required <= floats or len(floats) != len(chunk.properties) or chunk.has_lists:
        raise FormatError(
            f"{path}: expected 'chunk' of a compressed PLY to hold the floats min_x ... max_scale_z; export it again."
        )
    if sorted(words) != sorted((name, "u4") for name in PACKED) or vertex.has_lists:
        raise FormatError(f"{path}: expected 'vertex' to hold the uints {', '.join(PACKED)}; export it again.")
    if vertex.count == 0:
        raise FormatError(f"{path}: the file declares 0 Gaussians; export it again.")
    if chunk.count != math.ceil(vertex.count / CHUNK_ROWS):
        raise FormatError(
            f"{path}: expected {math.ceil(vertex.count / CHUNK_ROWS)} chunks for {vertex.count} Gaussians, got "
            f"{chunk.count}; the header is damaged, get the file again."
        )
    if sh is not None:
        columns = [(column.name, column.type_code) for column in sh.properties]
        if len(columns) not in (9, 24, 45) or columns != [(f"f_rest_{i}", "u1") for i in range(len(columns))]:
            raise FormatError(
                f"{path}: expected 'sh' to hold 9, 24 or 45 uchars f_rest_0, f_rest_1 ..., got {len(columns)} columns."
            )
        if sh.count != vertex.count:
            raise FormatError(f"{path}: expected as many rows in 'sh' as Gaussians, {vertex.count}, got {sh.count}.")
    return chunk, vertex, sh


def refuse_short_body(stream: BinaryIO, header: PlyHeader, path: Path) -> None:
    """Compare what the header promises with what the file holds, before memory is taken for it."""
    promised = sum(element.count * element.row_dtype(header.byte_order).itemsize for element in header.elements)
    remaining = path.stat().st_size - stream.tell()
    if promised > remaining:
        raise FormatError(
            f"{path}: the header promises {promised} bytes of Gaussians, but {remaining} bytes are left; the file is "
            "cut off or its counts are wrong, get it again."
        )


def unpacked(words: NDArray[Any], bits: tuple[int, ...]) -> NDArray[np.float32]:
    """Bit fields of each word, the highest first, as shares of their largest value; shape [N, len(bits)]."""
    words = words.astype(np.uint32)
    shifts = [sum(bits[i + 1 :]) for i in range(len(bits))]
    fields = [
        ((words >> np.uint32(shift)) & np.uint32(2**width - 1)) / np.float32(2**width - 1)
        for shift, width in zip(shifts, bits, strict=True)
    ]
    return np.stack(fields, axis=1).astype(np.float32)


def unpacked_quats(words: NDArray[Any]) -> NDArray[np.float32]:
    """Quaternions (w, x, y, z) whose largest component was left out; shape [N, 4]."""
    three = (unpacked(words, (2, 10, 10, 10))[:, 1:] - np.float32(0.5)) * np.float32(math.sqrt(2))
    largest = np.sqrt(np.maximum(1 - (three * three).sum(axis=1), 0))
    which = (words.astype(np.uint32) >> np.uint32(30)).astype(np.intp)
    quats = np.zeros((len(words), 4), np.float32)
    np.put_along_axis(quats, which[:, None], largest[:, None], axis=1)
    np.put_along_axis(quats, OTHERS[which], three, axis=1)
    return quats


def bounds_of(
    bounds: NDArray[Any], names: tuple[str, ...], count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper bounds of ``count`` Gaussians, each [count, 3], from the table of chunks."""
    table = np.stack([bounds[name].astype(np.float32) for name in names], axis=1)
    rows = np.repeat(table, CHUNK_ROWS, axis=0)[:count]
    return rows[:, :3], rows[:, 3:]


def between(lower: NDArray[np.float32], upper: NDArray[np.float32], share: NDArray[Any]) -> NDArray[np.float32]:
    """``lower`` where the share is 0, ``upper`` where it is 1; bounds that are no numbers give none."""
    with np.errstate(invalid="ignore", over="ignore"):
        return (lower * (1 - share) + upper * share).astype(np.float32)
