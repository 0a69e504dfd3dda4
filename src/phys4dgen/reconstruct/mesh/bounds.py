"""Mesh files from outside: refused before memory is taken where they promise more than they hold or than is sane."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from phys4dgen.errors import FormatError
from phys4dgen.formats.ply_header import read_ply_header
from phys4dgen.formats.splat_file import existing_file

__all__ = ["MAX_TRIANGLES", "FilesBeside", "check_bounds", "glb_header", "refuse"]

MAX_FILE_BYTES = 512 * 2**20
MAX_TRIANGLES = 20_000_000
MAX_HEADER_BYTES = 64 * 2**20
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_BESIDE = (".mtl", ".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".bin")


def refuse(path: Path, why: str) -> FormatError:
    """The error of a mesh file that is not usable."""
    return FormatError(f"{path}: cannot read it as a mesh: {why}; export it again as .glb.")


def check_bounds(path: Path) -> None:
    """Compare what the file promises with its size.

    Raises:
        FormatError: missing, too large, cut off, or it promises more than it holds.
    """
    size = existing_file(path).stat().st_size
    if size > MAX_FILE_BYTES:
        raise refuse(path, f"it is {size / 2**20:.0f} MB, expected {MAX_FILE_BYTES // 2**20} MB at most")
    if path.suffix.lower() == ".ply":
        _check_ply(path, size)
    elif path.suffix.lower() == ".glb":
        _check_glb(path, size)


def glb_header(path: Path) -> dict[str, Any]:
    """The JSON of a binary glTF file.

    Raises:
        FormatError: not one, or cut off.
    """
    with path.open("rb") as stream:
        start = stream.read(20)
        words = [int.from_bytes(start[place : place + 4], "little") for place in range(0, 20, 4)]
        if len(start) < 20 or start[:4] != b"glTF" or start[16:20] != b"JSON" or words[1] != 2:
            raise refuse(path, "it is no binary glTF of version 2")
        if words[3] > min(MAX_HEADER_BYTES, path.stat().st_size - 20) or words[2] > path.stat().st_size:
            raise refuse(path, "it is cut off")
        text = stream.read(words[3])
    try:
        header = json.loads(text.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise refuse(path, "its header is damaged") from error
    if not isinstance(header, dict):
        raise refuse(path, "its header is damaged")
    return header


def _check_glb(path: Path, size: int) -> None:
    """Accessors and views may not add up to far more than the file: each is copied when it is read."""
    header = glb_header(path)
    promised = 0
    try:
        for accessor in header.get("accessors", []):
            item = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
            promised += _count(accessor["count"]) * item
        promised += sum(_count(view["byteLength"]) for view in header.get("bufferViews", []))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise refuse(path, "its header is damaged") from error
    if promised > 4 * size + 2**20:
        raise refuse(path, f"its header promises {promised:,} bytes and the file has {size:,}")
    if "KHR_draco_mesh_compression" in str(header.get("extensionsRequired", "")):
        raise refuse(path, "it is compressed by Draco")


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**40:
        raise ValueError(value)
    return value


def _check_ply(path: Path, size: int) -> None:
    """Every row takes its bytes; a list takes at least those of its length."""
    with path.open("rb") as stream:
        header = read_ply_header(stream, path)
    least = 0
    for element in header.elements:
        row = 2 * len(element.properties)  # a digit and a separator each
        if header.encoding != "ascii":
            codes = (column.list_count_code or column.type_code for column in element.properties)
            row = sum(int(code[-1]) for code in codes)
        least += element.count * row
    if least > size - header.data_offset + 1:
        raise refuse(path, f"its header promises at least {least:,} bytes and {size - header.data_offset:,} follow it")


class FilesBeside(Mapping[str, bytes]):
    """The materials and textures that a mesh file names: those in its own folder and below, and no others.

    Args:
        folder: of the mesh file.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def __getitem__(self, name: str) -> bytes:
        """The content of a file; KeyError where there is none that may be read."""
        place = (self._folder / str(name).strip().replace("\\", "/")).resolve()
        allowed = place.is_relative_to(self._folder) and place.suffix.lower() in _BESIDE
        if not allowed or not place.is_file() or place.stat().st_size > MAX_FILE_BYTES:
            raise KeyError(name)
        return place.read_bytes()

    def __iter__(self) -> Iterator[str]:
        return (place.name for place in self._folder.iterdir() if place.suffix.lower() in _BESIDE)

    def __len__(self) -> int:
        return sum(1 for _ in self)
