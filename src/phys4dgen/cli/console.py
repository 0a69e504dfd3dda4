"""What a person sees while a run works: bars on a terminal, plain lines elsewhere. All of it goes to stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, TextIO

from phys4dgen.progress import Progress, SilentProgress

if TYPE_CHECKING:
    from rich.progress import TaskID

__all__ = ["PlainProgress", "console_progress"]

_SECONDS_BETWEEN_LINES = 10.0
"""In plain output, a long stage says how far it is at most this often."""


def console_progress(*, quiet: bool) -> AbstractContextManager[Progress]:
    """The progress that fits where stderr leads."""
    if quiet:
        return _silent()
    return _rich_bars() if sys.stderr.isatty() else _plain_lines(sys.stderr)


@contextmanager
def _silent() -> Iterator[Progress]:
    yield SilentProgress()


@contextmanager
def _plain_lines(stream: TextIO) -> Iterator[Progress]:
    progress = PlainProgress(stream)
    yield progress
    progress.close()


class PlainProgress:
    """One line when a stage begins and ends, and now and then in between."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._stage: str | None = None
        self._began = self._last_line = time.monotonic()
        self._work, self._work_began, self._last_update = "", self._began, self._began

    def stage(self, name: str) -> None:
        """Say how long the last stage took and which one begins."""
        self.close()
        self._stage = name
        self._began = self._last_line = time.monotonic()
        self._work, self._work_began, self._last_update = "", self._began, self._began
        self._say(f"{name} ...")

    def update(self, done: float, total: float, text: str = "") -> None:
        """Say how far the stage is, if it has been silent for long."""
        now = time.monotonic()
        if text != self._work:  # another kind of work in the same stage: its time left is its own
            self._work, self._work_began = text, self._last_update
        self._last_update = now
        if now - self._last_line >= _SECONDS_BETWEEN_LINES and total > 0:
            self._last_line = now
            left = (now - self._work_began) * (total - done) / done if done > 0 else float("nan")
            rest = f", about {left:.0f} s left" if left == left else ""
            self._say(f"  {100 * done / total:.0f} % {text}".rstrip() + rest)

    def note(self, text: str) -> None:
        """Say it."""
        self._say(f"  {text}")

    def warn(self, text: str) -> None:
        """Say it as a warning."""
        self._say(f"  warning: {text}")

    def close(self) -> None:
        """End the stage that is running."""
        if self._stage is not None:
            self._say(f"  {self._stage} took {time.monotonic() - self._began:.1f} s")
            self._stage = None

    def _say(self, line: str) -> None:
        self._stream.write(line + "\n")
        self._stream.flush()


@contextmanager
def _rich_bars() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    with RichProgress(
        TextColumn("{task.description:<12}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[text]}"),
        console=Console(stderr=True),
    ) as bars:
        progress = _RichProgress(bars)
        yield progress
        progress.close()


class _RichProgress:
    """One bar per stage, with the time left."""

    def __init__(self, bars: object) -> None:
        from rich.progress import Progress as RichProgress

        assert isinstance(bars, RichProgress)
        self._bars = bars
        self._task: TaskID | None = None

    def stage(self, name: str) -> None:
        """Complete the bar before and add one."""
        self.close()
        self._task = self._bars.add_task(name, total=None, text="")

    def update(self, done: float, total: float, text: str = "") -> None:
        """Move the bar of the stage."""
        if self._task is not None:
            self._bars.update(self._task, completed=done, total=total, text=text)

    def note(self, text: str) -> None:
        """Print above the bars."""
        self._bars.console.print(text, style="dim", markup=False, highlight=False)

    def warn(self, text: str) -> None:
        """Print above the bars, to be seen."""
        self._bars.console.print(f"warning: {text}", style="yellow", markup=False, highlight=False)

    def close(self) -> None:
        """Complete the bar of the stage that is running."""
        if self._task is not None:
            self._bars.update(self._task, completed=1, total=1, text="")
            self._bars.stop_task(self._task)
            self._task = None
