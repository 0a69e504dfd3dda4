"""The pictures of an object kept beside the answers: they are drawn once, and a person can see what was sent."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.formats.atomic import atomic_path
from phys4dgen.materials.mllm.subimages import MAX_PARTS, SubImages

__all__ = ["kept_pictures", "pictures_digest"]

_INDEX = "sent.json"
_DRAWING = 1
"""Goes up whenever the same object would be drawn differently."""
_LARGEST_BYTES = 16 << 20  # of one picture: far above what VIEW_PX and CROP_PX can give


def pictures_digest(arrays: Sequence[NDArray[np.generic] | None]) -> str:
    """Digest of everything that the pictures follow from: Gaussians, labels, frame, and the user's picture if any."""
    digest = hashlib.blake2b(f"drawing {_DRAWING}".encode(), digest_size=16)
    for array in arrays:
        if array is None:
            digest.update(b"none")
            continue
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def kept_pictures(folder: Path, digest: str, draw: Callable[[], SubImages]) -> SubImages:
    """The pictures of ``folder`` where they are those of ``digest``, else newly drawn ones, which are then kept.

    Args:
        folder: gets ``sent_object.png``, ``sent_parts.png``, one ``sent_part_LETTER.png`` per part, and their index.
        digest: see ``pictures_digest``.
        draw: makes the pictures.
    """
    found = _read(folder, digest)
    if found is not None:
        return found
    images = draw()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / _INDEX).unlink(missing_ok=True)
    for stale in folder.glob("sent_*.png"):
        stale.unlink()
    named = {"object": images.canonical, "parts": images.overlay}
    named |= {f"part_{letter}": png for letter, png in images.crops.items()}
    for name, png in named.items():
        with atomic_path(folder / f"sent_{name}.png") as temporary:
            temporary.write_bytes(png)
    index = {
        "digest": digest,
        "files": {name: hashlib.blake2b(png, digest_size=16).hexdigest() for name, png in named.items()},
        "letters": {letter: number for number, letter in images.letters.items()},
        "unseen": list(images.unseen),
    }
    with atomic_path(folder / _INDEX) as temporary:
        temporary.write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")
    return images


def _read(folder: Path, digest: str) -> SubImages | None:
    """The pictures of that digest, or None where they are others, damaged or not there."""
    try:
        index = json.loads((folder / _INDEX).read_text("utf-8"))
        if index["digest"] != digest or len(index["letters"]) > MAX_PARTS:
            return None
        letters = {int(number): letter for letter, number in index["letters"].items()}
        if not all(len(letter) == 1 and "A" <= letter <= "Z" for letter in letters.values()):
            return None
        pictures = {}
        for name in ("object", "parts", *(f"part_{letter}" for letter in letters.values())):
            path = folder / f"sent_{name}.png"
            if path.stat().st_size > _LARGEST_BYTES:
                return None
            pictures[name] = path.read_bytes()
            if hashlib.blake2b(pictures[name], digest_size=16).hexdigest() != index["files"][name]:
                return None
        crops = {letter: pictures[f"part_{letter}"] for letter in letters.values()}
        return SubImages(pictures["object"], pictures["parts"], crops, letters, tuple(map(int, index["unseen"])))
    except (OSError, ValueError, OverflowError, KeyError, TypeError, AttributeError, RecursionError):
        return None
