"""Text that comes from a model or a server: made harmless before anything is done with it."""

from __future__ import annotations

import re
import unicodedata

__all__ = ["harmless", "material_word"]

_MATERIAL = re.compile(r"[^\W\d_][\w ,()%&'./+-]{0,59}")


def harmless(text: object, *, limit: int = 300) -> str:
    """One printable line of at most ``limit`` characters: no control, escape or direction characters."""
    head = str(text)[: 4 * limit]
    kept = "".join(char if _is_plain(char) else " " for char in head)
    line = " ".join(kept.split())
    return line if len(line) <= limit else line[: limit - 1] + "…"


def material_word(text: object) -> str | None:
    """The name of a material as the model gave it, in small letters; None where it cannot be one.

    A name starts with a letter and has at most 60 characters of words; paths, markup and code are no names.
    """
    if not isinstance(text, str) or len(text) > 200:
        return None
    words = " ".join(text.replace("_", " ").split()).lower()
    if not _MATERIAL.fullmatch(words) or ".." in words or "__" in text:
        return None
    return words


def _is_plain(char: str) -> bool:
    return char == " " or unicodedata.category(char)[0] not in "CZ"
