"""Label maps of views that a user brings, from any segmentation program (``grouping.labels_file``).

Two forms are read:

- a folder with one picture per view and ``cameras.json``, as the ``views`` folder of a run: ``NAME_parts.png``,
  ``NAME.png`` or ``NAME.npy`` for the camera called NAME. In a PNG 0 abstains and k is part k - 1, as in the part maps
  that a run writes; in a .npy file -1 abstains and parts count from 0. Views without a file are left out.
- a ``.npz`` file with ``masks`` [V, H, W] (-1 abstains) and either ``viewmats`` [V, 4, 4] and ``Ks`` [V, 3, 3], or as
  many maps as the run has views. It may hold ``names`` of the parts.

Cameras are OpenCV, in the input's coordinates (docs/conventions.md).
"""

from __future__ import annotations

import json
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import FormatError
from phys4dgen.grouping.npy_files import read_npy, read_npz
from phys4dgen.types import Camera, Masks

__all__ = ["LabelMaps", "holds_label_maps", "read_cameras", "read_label_maps", "read_label_png"]

_MAX_VIEWS = 1000
_MAX_PIXELS = 1 << 27
"""Of all maps together: 120 views of 1024 x 1024."""
_MAX_LABELS = 256
_MAX_JSON_BYTES = 16 << 20
_GREY_MODES = ("1", "L", "P", "I", "I;16", "I;16B")


@dataclass(frozen=True, eq=False)
class LabelMaps:
    """Label maps with their cameras.

    Attributes:
        masks: labels 0 .. L-1 in the ascending order of the file's numbers, -1 abstains, shape [V, H, W].
        cameras: V cameras, of the size of the maps.
        numbers: the file's number of each label, shape [L].
        names: L names, or None.
    """

    masks: Masks
    cameras: tuple[Camera, ...]
    numbers: NDArray[np.int64]
    names: tuple[str, ...] | None


def holds_label_maps(path: Path | str) -> bool:
    """Whether ``read_label_maps`` is the reader of a labels file: a folder, or an archive with ``masks``."""
    path = Path(path)
    if path.is_dir():
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return "masks.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def read_label_maps(path: Path | str, *, cameras: Sequence[Camera] = ()) -> LabelMaps:
    """Read the label maps of a folder or a ``.npz`` file.

    Args:
        path: the folder or file.
        cameras: of the run's own views, for a file that brings none.

    Raises:
        FormatError: it holds no such maps, too many or too large ones, or they do not fit the cameras.
    """
    path = Path(path)
    if path.is_dir():
        masks, cameras = _read_folder(path)
        names = None
    elif path.suffix.lower() == ".npz":
        masks, cameras, names = _read_archive(path, cameras)
    else:
        raise FormatError(
            f"{path}: label maps are read from a folder or a .npz file, got '{path.suffix or path.name}'."
        )
    return _numbered(path, masks, tuple(cameras), names)


def _numbered(path: Path, masks: NDArray[Any], cameras: tuple[Camera, ...], names: NDArray[Any] | None) -> LabelMaps:
    """Renumber the labels without gaps."""
    if masks.min() < -1:
        raise FormatError(f"{path}: masks must hold numbers from 0, or -1 for none; got {int(masks.min())}.")
    numbers = np.unique(masks)
    numbers = numbers[numbers >= 0].astype(np.int64)
    if not 1 <= len(numbers) <= _MAX_LABELS:
        raise FormatError(f"{path}: masks must hold 1 to {_MAX_LABELS} different parts, got {len(numbers)}.")
    dense = np.where(masks >= 0, np.searchsorted(numbers, np.maximum(masks, 0)), -1).astype(np.int32)
    chosen = None
    if names is not None:
        if names.dtype.kind != "U" or names.ndim != 1 or len(names) <= numbers[-1]:
            raise FormatError(
                f"{path}: names must be a list of text with a name for each number from 0 to {numbers[-1]}, got "
                f"{names.dtype} of shape {names.shape}."
            )
        chosen = tuple(str(name) for name in names[numbers])
    return LabelMaps(Masks(dense), cameras, numbers, chosen)


def _read_folder(folder: Path) -> tuple[NDArray[np.int32], list[Camera]]:
    """The maps of a folder, with the cameras that they belong to."""
    maps: list[NDArray[np.int32]] = []
    used: list[Camera] = []
    pixels = 0
    for name, camera in read_cameras(folder / "cameras.json").items():
        found = [file for file in (folder / f"{name}{end}" for end in ("_parts.png", ".png", ".npy")) if file.is_file()]
        if not found:
            continue
        pixels += camera.width * camera.height
        if pixels > _MAX_PIXELS:
            raise FormatError(f"{folder}: label maps may hold {_MAX_PIXELS:,} pixels in all; use smaller ones.")
        maps.append(_read_npy_map(found[0], camera) if found[0].suffix == ".npy" else _read_png_map(found[0], camera))
        used.append(camera)
    if not maps:
        raise FormatError(
            f"{folder}: expected a label map for a camera of cameras.json (view_00_parts.png, view_00.png or "
            "view_00.npy), got none."
        )
    if len({(camera.width, camera.height) for camera in used}) > 1:
        raise FormatError(f"{folder}: expected label maps of one size, got several; make cameras and maps alike.")
    return np.stack(maps), used


def _read_archive(path: Path, cameras: Sequence[Camera]) -> tuple[NDArray[Any], Sequence[Camera], NDArray[Any] | None]:
    """Maps, cameras and names of a .npz file."""
    limits = {"masks": 8 * _MAX_PIXELS, "viewmats": 128 * _MAX_VIEWS, "Ks": 72 * _MAX_VIEWS, "names": 1 << 20}
    arrays = read_npz(path, "masks", limits)
    masks = arrays["masks"]
    if masks.ndim != 3 or masks.dtype.kind not in "iu" or not 0 < masks.size <= _MAX_PIXELS:
        raise FormatError(
            f"{path}: masks must be whole numbers of shape (views, height, width) with at most {_MAX_PIXELS:,} pixels, "
            f"got {masks.dtype} of shape {masks.shape}."
        )
    count, height, width = masks.shape
    if "viewmats" in arrays and "Ks" in arrays:
        viewmats, intrinsics = arrays["viewmats"], arrays["Ks"]
        if viewmats.shape != (count, 4, 4) or intrinsics.shape != (count, 3, 3):
            raise FormatError(
                f"{path}: {count} masks need viewmats of shape ({count}, 4, 4) and Ks of shape ({count}, 3, 3), got "
                f"{viewmats.shape} and {intrinsics.shape}."
            )
        cameras = [_camera(path, *pair, width, height) for pair in zip(viewmats, intrinsics, strict=True)]
    if len(cameras) != count:
        raise FormatError(f"{path}: {count} masks need as many cameras, got {len(cameras)}; add viewmats and Ks.")
    return masks, [_resized(path, camera, width, height) for camera in cameras], arrays.get("names")


def read_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of a ``cameras.json`` by name, in its order.

    Raises:
        FormatError: it cannot be read, or holds no such cameras.
    """
    try:
        if path.stat().st_size > _MAX_JSON_BYTES:
            raise FormatError(f"{path}: expected at most {_MAX_JSON_BYTES:,} bytes of cameras, got more.")
        tree = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise FormatError(f"{path}: cannot read the cameras of the label maps: {error.strerror or error}.") from error
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: expected JSON as in the views folder of a run, got something else.") from error
    entries = tree.get("cameras") if isinstance(tree, Mapping) else None
    if not isinstance(entries, list) or not 1 <= len(entries) <= _MAX_VIEWS:
        raise FormatError(f"{path}: expected a list called cameras with 1 to {_MAX_VIEWS} entries.")
    cameras: dict[str, Camera] = {}
    for number, entry in enumerate(entries):
        try:
            name, width, height = str(entry["name"]), int(entry["width"]), int(entry["height"])
            viewmat, intrinsics = entry["viewmat"], entry["K"]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise FormatError(
                f"{path}: cameras[{number}] needs name, width, height, K and viewmat; {error} is missing or wrong."
            ) from error
        if not name or Path(name).name != name or name in cameras:
            raise FormatError(f"{path}: cameras[{number}] needs a name of its own that can be a file's, got {name!r}.")
        cameras[name] = _camera(path, viewmat, intrinsics, width, height)
    return cameras


def _camera(path: Path, viewmat: Any, intrinsics: Any, width: int, height: int) -> Camera:
    try:
        return Camera(viewmat, intrinsics, width, height)
    except (TypeError, ValueError) as error:
        raise FormatError(f"{path}: a camera is not right: {error}") from error


def _resized(path: Path, camera: Camera, width: int, height: int) -> Camera:
    """The same view in pictures of another size."""
    if camera.width * height != camera.height * width:
        raise FormatError(
            f"{path}: masks of {width} x {height} px do not fit a view of {camera.width} x {camera.height} px; keep "
            "the shape of the views."
        )
    scale = width / camera.width
    return _camera(path, camera.viewmat, np.diag([scale, scale, 1.0]) @ camera.K, width, height)


def _read_png_map(path: Path, camera: Camera) -> NDArray[np.int32]:
    """One grey or indexed picture of a view; 0 abstains."""
    found = read_label_png(path, max_side_px=max(camera.width, camera.height))
    if found.shape != (camera.height, camera.width):
        raise FormatError(
            f"{path}: expected {camera.width} x {camera.height} px as its camera says, got {found.shape[1]} x "
            f"{found.shape[0]}."
        )
    return found


def read_label_png(path: Path, *, max_side_px: int) -> NDArray[np.int32]:
    """Read a grey or indexed PNG: value k is label k - 1, and 0 is -1, no label. Shape [H, W].

    Args:
        path: the file.
        max_side_px: pictures that are wider or higher are refused before they are decoded.

    Raises:
        FormatError: it cannot be read, is too large or coloured.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # its size is checked before it is decoded
            with Image.open(path, formats=("PNG",)) as picture:
                if max(picture.size) > max_side_px:
                    raise FormatError(
                        f"{path}: expected at most {max_side_px} px, got {picture.width} x {picture.height}."
                    )
                if picture.mode not in _GREY_MODES:
                    raise FormatError(
                        f"{path}: expected a grey or indexed picture whose values are part numbers, got {picture.mode}."
                    )
                return np.asarray(picture).astype(np.int32) - 1
    except FormatError:
        raise
    except MemoryError as error:  # a chunk that announces gigabytes
        raise FormatError(f"{path}: cannot read the label map: it promises far more than it holds.") from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise FormatError(f"{path}: cannot read the label map: {error}.") from error


def _read_npy_map(path: Path, camera: Camera) -> NDArray[np.int32]:
    """One array; -1 abstains."""
    array = read_npy(path, "the label map", 8 * camera.width * camera.height)
    if array.shape != (camera.height, camera.width) or array.dtype.kind not in "iu":
        raise FormatError(
            f"{path}: expected whole numbers of shape ({camera.height}, {camera.width}) as its camera says, got "
            f"{array.dtype} of shape {array.shape}."
        )
    return array.astype(np.int32)
