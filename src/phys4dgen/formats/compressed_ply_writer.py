"""Writes PlayCanvas compressed PLY: a quarter of the plain file's size, for viewers on the web.

``compressed_ply.py`` tells what the file holds. Gaussians are put in Morton order, so that the 256 of a chunk lie close
together and the steps between their bounds are small.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.formats.atomic import atomic_path
from phys4dgen.formats.compressed_ply import (
    CHUNK_ROWS,
    COLOR_BOUNDS,
    OTHERS,
    PACKED,
    POSITION_BOUNDS,
    SCALE_BOUNDS,
    SH_RANGE,
)
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["write_compressed_ply"]

_MORTON_BITS = 10
_WORDS_3D = (11, 10, 11)


def write_compressed_ply(gaussians: Gaussians, path: Path | str) -> None:
    """Write Gaussians quantised, in Morton order, atomically.

    Positions, logarithms of scales and colours lose what is finer than 1/1023 to 1/255 of their range within 256
    neighbours, rotations 0.1 degrees, opacities 1/510; coefficients of higher degrees are kept to 1/64 within -4 to 4.

    Raises:
        OSError: the place cannot be written.
    """
    order = morton_order(gaussians.means)
    means, log_scales = gaussians.means[order], np.log(gaussians.scales[order])
    rgb = np.float32(0.5) + np.float32(SH_C0) * gaussians.sh[order, 0]
    tables = [chunk_bounds(values) for values in (means, log_scales, rgb)]
    position, scale, color = (
        shares(values, bounds) for values, bounds in zip((means, log_scales, rgb), tables, strict=True)
    )
    opacity = gaussians.opacities[order].astype(np.float64)
    packed = np.stack(
        [
            bit_fields(position, _WORDS_3D),
            packed_quats(gaussians.quats_wxyz[order]),
            bit_fields(scale, _WORDS_3D),
            bit_fields(np.column_stack([color, opacity]), (8, 8, 8, 8)),
        ],
        axis=1,
    )
    rest = 3 * (gaussians.sh.shape[1] - 1)
    by_channel = gaussians.sh[order, 1:].transpose(0, 2, 1).reshape(len(order), rest).astype(np.float64)
    levels = np.rint(np.clip(by_channel / (2 * SH_RANGE) + 0.5, 0, 1) * 255).astype(np.uint8)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(header(len(order), rest))
        stream.write(np.concatenate(tables, axis=1).astype("<f4").data)
        stream.write(packed.astype("<u4").data)
        stream.write(levels.data)


def header(count: int, rest: int) -> bytes:
    """The head of a file of ``count`` Gaussians with ``rest`` coefficients of higher degrees each."""
    bounds = (*POSITION_BOUNDS, *SCALE_BOUNDS, *COLOR_BOUNDS)
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {math.ceil(count / CHUNK_ROWS)}"]
    lines += [f"property float {name}" for name in bounds]
    lines += [f"element vertex {count}", *(f"property uint {name}" for name in PACKED)]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def morton_order(points: NDArray[np.float32]) -> NDArray[np.intp]:
    """Rows of points [N, 3] along a Z curve through their bounding box, 1024 cells a side."""
    lower, extent = points.min(0).astype(np.float64), np.ptp(points, axis=0).astype(np.float64)
    cells = ((points - lower) / np.maximum(extent, 1e-300) * (2**_MORTON_BITS - 1)).astype(np.uint64)
    key = np.zeros(len(points), np.uint64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            key |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(key, kind="stable")


def chunk_bounds(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Lower and upper bounds of every 256 rows, [chunks, 6]."""
    first = np.arange(0, len(values), CHUNK_ROWS)
    return np.concatenate([np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)], axis=1)


def shares(values: NDArray[np.float32], bounds: NDArray[np.float32]) -> NDArray[np.float64]:
    """Where values [N, 3] lie between the bounds of their chunk, 0 to 1."""
    rows = np.repeat(bounds.astype(np.float64), CHUNK_ROWS, axis=0)[: len(values)]
    extent = rows[:, 3:] - rows[:, :3]
    return (values - rows[:, :3]) / np.where(extent > 0, extent, 1.0)


def bit_fields(share: NDArray[Any], bits: tuple[int, ...]) -> NDArray[np.uint32]:
    """Shares of 0 to 1 as the bit fields of one word each, the first the highest; [N]."""
    word = np.zeros(len(share), np.uint32)
    for values, width in zip(share.T, bits, strict=True):
        level = np.rint(np.clip(values, 0, 1) * (2**width - 1)).astype(np.uint32)
        word = (word << np.uint32(width)) | level
    return word


def packed_quats(quats_wxyz: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Unit quaternions [N, 4] without their largest component, which is made positive; [N]."""
    quats = quats_wxyz.astype(np.float64)
    which = np.abs(quats).argmax(axis=1)
    quats *= np.where(np.take_along_axis(quats, which[:, None], axis=1) < 0, -1.0, 1.0)
    three = np.take_along_axis(quats, OTHERS[which], axis=1) * math.sqrt(0.5) + 0.5
    return (which.astype(np.uint32) << np.uint32(30)) | bit_fields(three, (10, 10, 10))
