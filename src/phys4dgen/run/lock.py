"""One process at a time in a run folder.

The operating system holds the lock and drops it when the process ends, however it ends; so there is no stale lock to
clean up, and the process id in the file serves the message only.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO

from phys4dgen.errors import RunError

__all__ = ["FolderLock"]


class FolderLock:
    """Holds the lock file of a folder from ``acquire`` to ``release``."""

    NAME = ".lock"

    def __init__(self, folder: Path) -> None:
        self._path = folder / self.NAME
        self._file: IO[str] | None = None

    def acquire(self) -> None:
        """Take the lock.

        Raises:
            RunError: another process holds it (named by its id), or the folder cannot be written.
        """
        try:
            file = self._path.open("a+", encoding="ascii")
        except OSError as error:
            raise RunError(f"{self._path.parent}: cannot write into the run folder: {error.strerror}.") from error
        if not _try_lock(file):
            file.seek(0)
            owner = file.read(20).strip() or "unknown"
            file.close()
            raise RunError(
                f"{self._path.parent}: another phys4dgen (process {owner}) is working in this run folder; "
                "wait for it, or choose another folder with -o."
            )
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        self._file = file

    def release(self) -> None:
        """Give the lock back; harmless when it is not held."""
        if self._file is not None:
            self._file.close()
            self._file = None


if sys.platform == "win32":
    import msvcrt

    def _try_lock(file: IO[str]) -> bool:
        try:
            file.seek(1 << 20)  # beyond the process id, so that others can read it
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _try_lock(file: IO[str]) -> bool:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True
