"""Splat files in and out: one codec per file, chosen by content first and suffix second."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from phys4dgen.errors import FormatError, did_you_mean
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.formats.compressed_ply_writer import write_compressed_ply
from phys4dgen.formats.ply import PlyFrameWriter, read_ply, write_ply
from phys4dgen.formats.splat import read_splat, write_splat
from phys4dgen.formats.splat_file import SplatFile, existing_file
from phys4dgen.types import Gaussians

__all__ = [
    "PlyFrameWriter",
    "SplatFile",
    "atomic_path",
    "check_writable_suffix",
    "is_compressed_name",
    "load_gaussians",
    "read_ply",
    "read_splat",
    "read_splat_file",
    "save_gaussians",
    "write_compressed_ply",
    "write_ply",
    "write_splat",
]

READERS = {".ply": read_ply, ".splat": read_splat}
WRITERS = {".ply": write_ply, ".splat": write_splat}
LATER = {
    **dict.fromkeys((".spz", ".ksplat", ".sog"), "convert it to .ply or .splat (for example with SuperSplat)"),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".webp"), "'phys4dgen generate' makes a splat of a picture"),
}
MESHES = (".glb", ".gltf", ".obj", ".stl")

Function = TypeVar("Function")

_log = logging.getLogger(__name__)


def load_gaussians(path: Path | str) -> Gaussians:
    """Read the Gaussians of a splat file; what the reader repaired goes to the log.

    Raises:
        FormatError: missing, damaged or not a format that this version reads.
    """
    splat = read_splat_file(path)
    for note in splat.notes:
        _log.warning("%s: %s", path, note)
    return splat.gaussians


def read_splat_file(path: Path | str) -> SplatFile:
    """Read a splat file with its extra columns and the reader's notes; a PLY is known by its first bytes.

    Raises:
        FormatError: as ``load_gaussians``.
    """
    path = existing_file(path)
    try:
        with path.open("rb") as stream:
            starts_as_ply = stream.read(4) in (b"ply\n", b"ply\r")
        return read_ply(path) if starts_as_ply else codec(path, READERS, "read")(path)
    except OSError as error:
        raise FormatError(f"{path}: the file cannot be read ({error}); check its rights and the disk.") from error


def save_gaussians(gaussians: Gaussians, path: Path | str) -> None:
    """Write Gaussians atomically, in the format that the name of the file ends with.

    ``.ply`` is the INRIA layout, lossless to float32; ``.compressed.ply`` PlayCanvas's, which loses little and puts the
    Gaussians in another order; ``.splat`` has 8 bits per value and no spherical harmonics.

    Raises:
        FormatError: a suffix that this version does not write, or a place that cannot be written.
    """
    path = Path(path)
    write = write_compressed_ply if is_compressed_name(path) else codec(path, WRITERS, "write")
    if write is write_splat and gaussians.sh_degree:
        _log.warning("%s: .splat holds no spherical harmonics; degree %d becomes 0.", path, gaussians.sh_degree)
    try:
        write(gaussians, path)
    except OSError as error:
        raise FormatError(f"{path}: the file cannot be written ({error}); check folder, rights and disk.") from error


def is_compressed_name(path: Path) -> bool:
    """Whether a file of this name is to be PlayCanvas's compressed PLY, which viewers tell by both suffixes."""
    return path.name.lower().endswith(".compressed.ply")


def check_writable_suffix(path: Path | str) -> None:
    """Raise what ``save_gaussians`` would for the suffix of a path.

    Raises:
        FormatError: a suffix that this version does not write.
    """
    codec(Path(path), WRITERS, "write")


def codec(path: Path, known: Mapping[str, Function], verb: str) -> Function:
    """The reader or writer for the suffix of ``path``."""
    suffix = path.suffix.lower()
    if suffix in known:
        return known[suffix]
    supported = " and ".join(known)
    if suffix in LATER:
        raise FormatError(
            f"{path}: {suffix} files come in a later version, this one can {verb} {supported}; {LATER[suffix]}."
        )
    if suffix in MESHES:
        raise FormatError(
            f"{path}: {suffix} is a mesh, expected {supported}; 'phys4dgen generate' makes a splat of .glb, .obj, .stl "
            "and .ply meshes."
        )
    got = f"the suffix '{suffix[:20]}'" if suffix else "no suffix"
    raise FormatError(f"{path}: cannot {verb} a file with {got}, expected {supported}.{did_you_mean(suffix, known)}")
