"""``trajectory.npz``: the motion of all Gaussians, streamed frame by frame and read without trusting it.

An uncompressed zip of three .npy members, so that ``numpy.load`` opens it: ``times_s`` [T] float64, ``positions``
[T, N, 3] float32, ``deformation_gradients`` [T, N, 3, 3] float32.
"""

from __future__ import annotations

import io
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.formats import atomic_path
from phys4dgen.formats.npy_header import read_npy_header
from phys4dgen.types import Trajectory

__all__ = ["read_trajectory", "trajectory_writer", "write_trajectory"]

MEMBERS = {"times_s": (1, np.float64), "positions": (3, np.float32), "deformation_gradients": (4, np.float32)}
COPY_BYTES = 1 << 20


@contextmanager
def trajectory_writer(
    path: Path | str, *, times_s: NDArray[Any], gaussian_count: int
) -> Iterator[Callable[[NDArray[Any], NDArray[Any]], None]]:
    """Yield ``append(positions, deformation_gradients)``, to be called once per frame; then the file appears.

    ``positions`` are in input units, shape [N, 3]; ``deformation_gradients`` are the total F in the input's axes,
    shape [N, 3, 3]. A zip holds one open member at a time, so positions go straight into it and the gradients wait in
    an unnamed temporary file beside it.
    """
    path = Path(path)
    times = np.ascontiguousarray(times_s, "<f8")
    written = 0
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive,
        tempfile.TemporaryFile(dir=path.parent) as gradients,
    ):
        with open_member(archive, "times_s", times.shape) as member:
            member.write(times.data)
        with open_member(archive, "positions", (len(times), gaussian_count, 3)) as member:

            def append(positions: NDArray[Any], deformation_gradients: NDArray[Any]) -> None:
                nonlocal written
                member.write(frame_data("positions", positions, (gaussian_count, 3)))
                gradients.write(frame_data("deformation_gradients", deformation_gradients, (gaussian_count, 3, 3)))
                written += 1

            yield append
        if written != len(times):
            raise ValueError(f"trajectory_writer: expected {len(times)} frames, got {written}; nothing was written.")
        gradients.seek(0)
        with open_member(archive, "deformation_gradients", (written, gaussian_count, 3, 3)) as member:
            shutil.copyfileobj(gradients, member, COPY_BYTES)


def open_member(archive: zipfile.ZipFile, name: str, shape: tuple[int, ...]) -> IO[bytes]:
    """Open a .npy member for writing, with its header written."""
    header = io.BytesIO()
    descr = np.dtype(MEMBERS[name][1]).newbyteorder("<").str
    np.lib.format.write_array_header_1_0(header, {"descr": descr, "fortran_order": False, "shape": shape})
    # ZipInfo's fixed date keeps two runs of the same scene identical byte for byte.
    member = archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)
    member.write(header.getvalue())
    return member


def frame_data(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> memoryview:
    """The bytes of one frame of an array, after checking its shape."""
    if values.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {values.shape}.")
    return np.ascontiguousarray(values, "<f4").data


def write_trajectory(trajectory: Trajectory, path: Path | str) -> None:
    """Write a trajectory that is already in memory."""
    count = trajectory.positions.shape[1]
    with trajectory_writer(path, times_s=trajectory.times_s, gaussian_count=count) as append:
        for positions, gradients in zip(trajectory.positions, trajectory.deformation_gradients, strict=True):
            append(positions, gradients)


def read_trajectory(path: Path | str) -> Trajectory:
    """Read ``trajectory.npz``; sizes are checked against the file before memory is taken, pickles are refused.

    Raises:
        FormatError: missing, damaged or not a trajectory.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {name: read_member(archive, name, path) for name in MEMBERS}
        return Trajectory(**arrays)
    except FileNotFoundError as error:
        raise FormatError(f"{path}: there is no such file; run the simulate stage first.") from error
    except (zipfile.BadZipFile, ValueError, EOFError, RuntimeError, NotImplementedError, OSError) as error:
        raise FormatError(f"{path}: not a readable trajectory ({error}); run the simulate stage again.") from error


def read_member(archive: zipfile.ZipFile, name: str, path: Path) -> NDArray[Any]:
    """One array of the archive, of the type and number of dimensions that MEMBERS asks for."""
    rank, dtype = MEMBERS[name]
    if f"{name}.npy" not in archive.namelist():
        raise FormatError(f"{path}: the array '{name}' is missing; run the simulate stage again.")
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED or info.file_size > path.stat().st_size:
        raise FormatError(f"{path}: expected '{name}' uncompressed; save the file with numpy.savez.")
    with archive.open(info) as stream:
        shape, fortran_order, found = read_npy_header(stream)
        if found != np.dtype(dtype).newbyteorder("<") or fortran_order or len(shape) != rank:
            raise FormatError(
                f"{path}: expected '{name}' as {np.dtype(dtype)} of {rank} dimensions in C order, got {found} {shape}."
            )
        count = 1
        for length in shape:  # Python integers: a hostile shape overflows NumPy's
            count *= length
        if min(shape) < 1 or stream.tell() + count * found.itemsize != info.file_size:
            raise FormatError(
                f"{path}: '{name}' promises shape {shape}, which is not what its {info.file_size} bytes hold."
            )
        values = np.zeros(shape, dtype)
        target = values.reshape(-1).view(np.uint8).data
        filled = 0
        while filled < len(target):
            chunk = stream.read(min(COPY_BYTES, len(target) - filled))
            if not chunk:
                raise EOFError(f"'{name}' is cut off")
            target[filled : filled + len(chunk)] = chunk
            filled += len(chunk)
    return values
