"""What a long run tells the person who waits: a protocol, and the silent default."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

__all__ = ["SILENT", "Progress", "SilentProgress"]


@runtime_checkable
class Progress(Protocol):
    """Told by the pipeline, shown by the command line (or by whoever calls the library)."""

    def stage(self, name: str) -> None:
        """A stage begins; the one before it has ended."""
        ...

    def update(self, done: float, total: float, text: str = "") -> None:
        """``done`` of ``total`` units of the stage's work are finished; ``text`` says what a unit is."""
        ...

    def note(self, text: str) -> None:
        """Something that is good to know: a count, a choice, a prediction."""
        ...

    def warn(self, text: str) -> None:
        """Something that the user should act on or know when judging the result; it also stands in the report."""
        ...


class SilentProgress:
    """Says nothing."""

    def stage(self, name: str) -> None:
        """Ignore."""

    def update(self, done: float, total: float, text: str = "") -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""

    def warn(self, text: str) -> None:
        """Ignore."""


SILENT = SilentProgress()
"""The default of every function that takes a ``progress``."""
