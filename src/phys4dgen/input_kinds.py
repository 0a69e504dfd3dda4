"""What the name of an input file promises."""

from __future__ import annotations

from pathlib import Path

__all__ = ["PICTURE_SUFFIXES", "is_picture"]

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")


def is_picture(path: Path | str) -> bool:
    """Whether the name of a file promises a picture."""
    return Path(path).suffix.lower() in PICTURE_SUFFIXES
