"""Programs of the user's choice: started without a shell, with a time limit, and ended with all their children."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from phys4dgen.errors import StageError

__all__ = ["run_program"]

_LAST_WORDS = 300
"""Characters of what a failed program said that the error repeats."""
_GRACE_S = 5.0
_TELL_EVERY_S = 1.0


def run_program(
    words: Sequence[str],
    folder: Path,
    *,
    timeout_s: float,
    timeout_key: str,
    on_wait: Callable[[float], None] | None = None,
) -> None:
    """Run a program to its end, in a process group of its own.

    Args:
        words: the program and its arguments; what it says goes to ``log.txt``.
        folder: its current folder.
        timeout_s: it is ended after this time.
        timeout_key: key of the scene that sets this, for the error.
        on_wait: called every second with the seconds since the start.

    Raises:
        StageError: it cannot be started, fails, or takes too long.
    """
    name, log = words[0], folder / "log.txt"
    with log.open("wb") as said:
        try:
            process = subprocess.Popen(
                words, cwd=folder, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True
            )
        except OSError as error:
            raise StageError(
                f"The command '{name}' cannot be started ({error.strerror or error}); give its full path."
            ) from error
        try:
            code = _wait(process, timeout_s, on_wait)
        except subprocess.TimeoutExpired as error:
            raise StageError(
                f"The command '{name}' was ended after {timeout_s:g} s; allow more with {timeout_key}."
            ) from error
        finally:
            _end_group(process)
    if code != 0:
        raise StageError(f"The command '{name}' failed with exit code {code}; it said: {_last_words(log)}")


def _wait(process: subprocess.Popen[bytes], timeout_s: float, on_wait: Callable[[float], None] | None) -> int:
    start = time.monotonic()
    while True:
        passed_s = time.monotonic() - start
        if on_wait is not None:
            on_wait(passed_s)
        if passed_s >= timeout_s:
            raise subprocess.TimeoutExpired(process.args, timeout_s)
        try:
            return process.wait(min(_TELL_EVERY_S, timeout_s - passed_s))
        except subprocess.TimeoutExpired:
            continue


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End what the program has left running."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, sign)
        except (ProcessLookupError, PermissionError):
            break
        try:
            process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            continue


def _last_words(log: Path) -> str:
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - 4 * _LAST_WORDS))
        text = " ".join(stream.read().decode("utf-8", "replace").split())
    return text[-_LAST_WORDS:] or "nothing"
