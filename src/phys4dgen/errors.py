"""Every error that a user may meet.

Each message is one readable sentence: what is wrong, where, what was expected, what was got, and how to fix it.
The command line prints the message alone; the traceback appears only with ``-vv``.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = [
    "FormatError",
    "MaterialError",
    "Phys4DGenError",
    "RunError",
    "SceneError",
    "SimulationError",
    "StageError",
    "did_you_mean",
]


class Phys4DGenError(Exception):
    """Base of all errors that phys4dgen raises on purpose; its text is meant for users.

    What a sentence quotes of a file may hold anything: characters that a terminal would obey or not show are escaped.
    """

    def __init__(self, sentence: str = "") -> None:
        shown = (c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in sentence)
        super().__init__("".join(shown))


class FormatError(Phys4DGenError):
    """A file is not what its name or header promises, or asks for more than it holds."""


class SceneError(Phys4DGenError):
    """A scene file, flag or option is unknown, out of range or refers to something that does not exist."""


class MaterialError(Phys4DGenError):
    """A material name, value or law is unknown or outside the range that physics allows."""


class SimulationError(Phys4DGenError):
    """The simulation cannot start or had to stop; the text names frame, time, part and cause."""


class StageError(Phys4DGenError):
    """A stage cannot make its result from what it was given."""


class RunError(Phys4DGenError):
    """A run folder is missing, locked, of another input, or cannot be written."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``" Did you mean 'x'?"`` for the closest known word, or an empty string."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.55)
    return f" Did you mean '{close[0]}'?" if close else ""
