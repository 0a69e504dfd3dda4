"""3D Gaussian Splatting PLY: read by property name in any order, written in the INRIA layout.

Conventions (graphdeco-inria/gaussian-splatting, ``scene/gaussian_model.py``): ``opacity`` is a logit, ``scale_*`` are
natural logarithms, ``rot_*`` is (w, x, y, z) and need not be of unit length, colour = 0.5 + SH_C0 * f_dc, and
``f_rest_*`` is channel-major: all coefficients of red, then green, then blue. LGM writes the same without normals and
``f_rest``; other tools change the order, the types or add columns.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.formats.compressed_ply import is_compressed, read_compressed_ply
from phys4dgen.formats.ply_header import PlyElement, PlyHeader, read_ply_header
from phys4dgen.formats.splat_file import (
    LARGEST_VALUE,
    SplatFile,
    existing_file,
    raise_scales,
    refuse_invalid_rows,
    unit_quaternions,
)
from phys4dgen.types import Gaussians

__all__ = ["PlyFrameWriter", "read_ply", "write_ply"]

MEANS = ("x", "y", "z")
NORMALS = ("nx", "ny", "nz")
SH_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES = ("scale_0", "scale_1", "scale_2")
QUATS = ("rot_0", "rot_1", "rot_2", "rot_3")
REQUIRED = (*MEANS, *SH_DC, "opacity", *SCALES, *QUATS)

LARGEST_LOG_SCALE = 41.0
"""exp(41) = 6e17: squares of larger scales leave float32."""

LARGEST_LOGIT = 16.635532
"""Logit of 1 - 2^-24, the largest opacity below 1 in float32; opacities of 0 and 1 are written as -/+ this."""

LARGEST_QUAT = float(np.finfo(np.float32).max)

BLOCK_ROWS = 4096
MAX_LIST_ROWS = 1_000_000


def read_ply(path: Path | str) -> SplatFile:
    """Read a 3DGS PLY of SH degree 0 to 3 in any property order, scalar type and encoding, or PlayCanvas compressed.

    Raises:
        FormatError: not a 3DGS PLY, damaged, cut off, or with values that are not usable numbers.
    """
    path = existing_file(path)
    with path.open("rb") as stream:
        header = read_ply_header(stream, path)
        if is_compressed(header):
            return read_compressed_ply(stream, header, path)
        vertex = vertex_element(header, path)
        skip_to_vertex(stream, header, path)
        refuse_short_body(stream, header, vertex, path)
        raw = gather(stream, header, vertex, path)
    coefficients = raw.sh.shape[1]
    refuse_invalid_rows(
        path,
        [
            (MEANS, raw.means, -LARGEST_VALUE, LARGEST_VALUE),
            (sh_names(coefficients), raw.sh.reshape(vertex.count, -1), -LARGEST_VALUE, LARGEST_VALUE),
            (("opacity",), raw.logits, -np.inf, np.inf),  # infinite logits are opacities of exactly 0 and 1
            (SCALES, raw.log_scales, -np.inf, LARGEST_LOG_SCALE),  # minus infinity is a scale of exactly 0
            (QUATS, raw.quats, -LARGEST_QUAT, LARGEST_QUAT),
        ],
    )
    scales, scale_notes = raise_scales(np.exp(raw.log_scales))
    quats, quat_notes = unit_quaternions(raw.quats)
    return SplatFile(
        gaussians=Gaussians(
            means=raw.means, quats_wxyz=quats, scales=scales, opacities=sigmoid(raw.logits[:, 0]), sh=raw.sh
        ),
        layout=f"PLY, {header.encoding}, {len(vertex.properties)} properties",
        extra=raw.extra,
        notes=(*quat_notes, *scale_notes),
    )


def write_ply(gaussians: Gaussians, path: Path | str) -> None:
    """Write a binary little-endian INRIA PLY with zero normals and ``f_rest`` up to the degree of ``gaussians``."""
    PlyFrameWriter(gaussians).write(
        path, means=gaussians.means, quats_wxyz=gaussians.quats_wxyz, scales=gaussians.scales
    )


class PlyFrameWriter:
    """Writes many frames of the same Gaussians: opacities, colours and header are prepared once."""

    def __init__(self, gaussians: Gaussians) -> None:
        n, coefficients = gaussians.sh.shape[:2]
        rest_count = 3 * (coefficients - 1)
        names = (*MEANS, *NORMALS, *SH_DC, *f_rest_names(rest_count), "opacity", *SCALES, *QUATS)
        lines = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
        lines += [f"property float {name}" for name in names]
        self._header = "\n".join([*lines, "end_header", ""]).encode("ascii")
        self._table = np.zeros((n, len(names)), "<f4")
        self._table[:, 6:9] = gaussians.sh[:, 0]
        self._write_f_rest(gaussians.sh[:, 1:])
        self._table[:, 9 + rest_count] = logit(gaussians.opacities)

    def write(
        self,
        path: Path | str,
        *,
        means: NDArray[Any],
        quats_wxyz: NDArray[Any],
        scales: NDArray[Any],
        sh_rest: NDArray[Any] | None = None,
    ) -> None:
        """Write one frame atomically.

        Args:
            path: file to make or replace.
            means: centres, shape [N, 3], input units.
            quats_wxyz: unit quaternions, shape [N, 4].
            scales: linear standard deviations, positive, shape [N, 3], input units.
            sh_rest: coefficients above the constant one, shape [N, K-1, 3]; None keeps those written last.
        """
        table = self._table
        table[:, 0:3] = means
        if sh_rest is not None:
            self._write_f_rest(sh_rest)
        table[:, -7:-4] = np.log(scales)
        table[:, -4:] = quats_wxyz
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            stream.write(self._header)
            stream.write(table.data)

    def _write_f_rest(self, sh_rest: NDArray[Any]) -> None:
        n, count = len(self._table), self._table.shape[1] - 17
        if sh_rest.shape != (n, count // 3, 3):
            raise ValueError(f"sh_rest: expected shape {(n, count // 3, 3)}, got {sh_rest.shape}.")
        for channel in range(3):
            first = 9 + channel * (count // 3)
            self._table[:, first : first + count // 3] = sh_rest[:, :, channel]


def vertex_element(header: PlyHeader, path: Path) -> PlyElement:
    """The element that holds the Gaussians, with every required scalar column."""
    found = [element for element in header.elements if element.name == "vertex"]
    if not found:
        raise FormatError(f"{path}: the PLY file has no 'vertex' element, so it holds no Gaussians; export a 3DGS PLY.")
    vertex = found[0]
    names = {column.name for column in vertex.properties}
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        listed = ", ".join(missing[:6]) + (", ..." if len(missing) > 6 else "")
        raise FormatError(
            f"{path}: expected a 3D Gaussian Splatting PLY, but 'vertex' lacks {len(missing)} of its properties "
            f"({listed}); a mesh or point cloud has to be trained or converted to Gaussians first."
        )
    if vertex.has_lists:
        raise FormatError(f"{path}: expected one number per property in 'vertex', got a list property; remove it.")
    if vertex.count == 0:
        raise FormatError(f"{path}: the file declares 0 Gaussians; export it again.")
    return vertex


def f_rest_count(vertex: PlyElement, path: Path) -> int:
    """Number of ``f_rest`` columns: 0, 9, 24 or 45."""
    present = {column.name for column in vertex.properties if column.name.startswith("f_rest_")}
    if len(present) not in (0, 9, 24, 45) or present != set(f_rest_names(len(present))):
        raise FormatError(
            f"{path}: expected 0, 9, 24 or 45 properties f_rest_0, f_rest_1 ... (SH degree 0 to 3), got {len(present)}"
            "; export the file again with a whole SH degree."
        )
    return len(present)


def skip_to_vertex(stream: BinaryIO, header: PlyHeader, path: Path) -> None:
    """Move ``stream`` from the first element to the first row of ``vertex``."""
    size = path.stat().st_size
    for element in itertools.takewhile(lambda element: element.name != "vertex", header.elements):
        if header.encoding == "ascii":
            skipped = sum(1 for _ in itertools.islice(stream, min(element.count, size)))
            complete = skipped == element.count
        elif not element.has_lists:
            end = stream.tell() + element.count * element.row_dtype(header.byte_order).itemsize
            complete = end <= size
            stream.seek(min(end, size))
        else:
            complete = skip_list_rows(stream, element, header.byte_order, size)
        if not complete:
            raise FormatError(
                f"{path}: element {element.name!a} before 'vertex' promises {element.count} rows that the file "
                "does not hold; it is cut off or damaged, get it again."
            )


def skip_list_rows(stream: BinaryIO, element: PlyElement, byte_order: str, size: int) -> bool:
    """Step over rows whose length is known only from their content; False if the file ends before they do."""
    if element.count > min(size, MAX_LIST_ROWS):
        return False
    for _ in range(element.count):
        for column in element.properties:
            items = 1
            if column.list_count_code is not None:
                count_type = np.dtype(byte_order + column.list_count_code)
                raw = stream.read(count_type.itemsize)
                if len(raw) < count_type.itemsize:
                    return False
                items = int(np.frombuffer(raw, count_type)[0])
            end = stream.tell() + items * np.dtype(column.type_code).itemsize
            if items < 0 or end > size:
                return False
            stream.seek(end)
    return True


def refuse_short_body(stream: BinaryIO, header: PlyHeader, vertex: PlyElement, path: Path) -> None:
    """Compare what the header promises with what the file holds, before memory is taken for it."""
    remaining = path.stat().st_size - stream.tell()
    if header.encoding == "ascii":
        row_bytes = 2 * len(vertex.properties)  # a digit and a separator each
        promised = vertex.count * row_bytes - 1
    else:
        row_bytes = vertex.row_dtype(header.byte_order).itemsize
        promised = vertex.count * row_bytes
    if promised > remaining:
        raise FormatError(
            f"{path}: the header promises {vertex.count} Gaussians ({promised} bytes), but {remaining} bytes are left, "
            f"enough for {remaining // row_bytes}; the file is cut off or the count is wrong, get it again."
        )


class RawColumns(NamedTuple):
    """What the file says, in float32: logits [N, 1], logarithms of scales [N, 3], quaternions of any length [N, 4]."""

    means: NDArray[np.float32]
    sh: NDArray[np.float32]
    logits: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    quats: NDArray[np.float32]
    extra: dict[str, NDArray[Any]]


def gather(stream: BinaryIO, header: PlyHeader, vertex: PlyElement, path: Path) -> RawColumns:
    """Read all rows of ``vertex``, block by block, into one array per quantity."""
    n = vertex.count
    rest = f_rest_names(f_rest_count(vertex, path))
    known = {*REQUIRED, *NORMALS, *rest}
    raw = RawColumns(
        means=np.zeros((n, 3), np.float32),
        sh=np.zeros((n, 1 + len(rest) // 3, 3), np.float32),
        logits=np.zeros((n, 1), np.float32),
        log_scales=np.zeros((n, 3), np.float32),
        quats=np.zeros((n, 4), np.float32),
        extra={c.name: np.zeros(n, "=" + c.type_code) for c in vertex.properties if c.name not in known},
    )
    start = 0
    for block in blocks(stream, header, vertex, path):
        rows = slice(start, start + len(block))
        raw.means[rows] = columns(block, MEANS)
        raw.sh[rows, 0] = columns(block, SH_DC)
        if rest:
            raw.sh[rows, 1:] = columns(block, rest).reshape(len(block), 3, -1).transpose(0, 2, 1)  # channel-major
        raw.logits[rows] = columns(block, ("opacity",))
        raw.log_scales[rows] = columns(block, SCALES)
        raw.quats[rows] = columns(block, QUATS)
        for name, values in raw.extra.items():
            values[rows] = block[name]
        start += len(block)
    return raw


def blocks(stream: BinaryIO, header: PlyHeader, vertex: PlyElement, path: Path) -> Iterator[NDArray[Any]]:
    """Structured arrays of up to BLOCK_ROWS rows, small enough to stay in cache while columns are gathered."""
    dtype = vertex.row_dtype(header.byte_order)
    for start in range(0, vertex.count, BLOCK_ROWS):
        rows = min(BLOCK_ROWS, vertex.count - start)
        if header.encoding == "ascii":
            block = ascii_rows(stream, rows, dtype, path)
        else:
            block = np.fromfile(stream, dtype, rows)
        if len(block) < rows:
            raise FormatError(
                f"{path}: the file ends at Gaussian {start + len(block)} of {vertex.count}; it is cut off."
            )
        yield block


def ascii_rows(stream: BinaryIO, rows: int, dtype: np.dtype, path: Path) -> NDArray[Any]:
    """Up to ``rows`` rows of numbers, one per line; fewer at the end of the file."""
    lines = [line.decode("latin-1") for line in itertools.islice(stream, rows)]
    if not all(line.strip() for line in lines):
        raise FormatError(f"{path}: expected one Gaussian per line of the ASCII PLY, got an empty line; remove it.")
    if not lines:
        return np.zeros(0, dtype)
    try:
        return np.loadtxt(lines, dtype, comments=None, ndmin=1)
    except (ValueError, OverflowError) as error:
        raise FormatError(
            f"{path}: a line of the ASCII PLY does not match its header ({error}); export it again."
        ) from error


def columns(block: NDArray[Any], names: tuple[str, ...]) -> NDArray[np.float32]:
    """The named columns of a structured block side by side, shape [rows, len(names)]."""
    first = first_of_run(block.dtype, names)
    if first is not None:
        return block.view(np.float32).reshape(len(block), -1)[:, first : first + len(names)]
    with np.errstate(over="ignore"):  # a double beyond float32 becomes infinite and is refused with its name
        return np.stack([block[name] for name in names], axis=1, dtype=np.float32, casting="same_kind")


@functools.lru_cache(maxsize=64)
def first_of_run(dtype: np.dtype, names: tuple[str, ...]) -> int | None:
    """Index of the first column if rows are all native float32 and ``names`` are neighbours in order, else None."""
    fields = dtype.names or ()
    first = fields.index(names[0])
    neighbours = fields[first : first + len(names)] == names
    return first if neighbours and all(dtype[name] == np.float32 for name in fields) else None


def f_rest_names(count: int) -> tuple[str, ...]:
    """Names of the first ``count`` higher SH columns."""
    return tuple(f"f_rest_{i}" for i in range(count))


def sh_names(coefficients: int) -> tuple[str, ...]:
    """File names of the coefficients in the order of ``Gaussians.sh`` flattened to [N, K * 3]."""
    rest = [f"f_rest_{channel * (coefficients - 1) + k}" for k in range(coefficients - 1) for channel in range(3)]
    return (*SH_DC, *rest)


def sigmoid(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Opacity of a logit, exact in both tails."""
    decay = np.exp(-np.abs(logits.astype(np.float64)))
    return (np.where(logits >= 0, 1.0, decay) / (1.0 + decay)).astype(np.float32)


def logit(opacities: NDArray[np.float32]) -> NDArray[np.float32]:
    """Logit of an opacity in [0, 1], limited to +/- LARGEST_LOGIT."""
    p = np.clip(opacities.astype(np.float64), 1e-30, 1 - 2.0**-53)
    return np.clip(np.log(p) - np.log1p(-p), -LARGEST_LOGIT, LARGEST_LOGIT).astype(np.float32)
