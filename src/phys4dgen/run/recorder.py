"""Listens to a run's progress: times its stages, keeps its warnings for the report, writes the log, and passes on."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

from phys4dgen.progress import Progress

__all__ = ["RecordingProgress", "StageTime"]

_log = logging.getLogger("phys4dgen.run")


@dataclass
class StageTime:
    """Wall-clock seconds of one stage; of a reused one those that it took when it was made."""

    name: str
    seconds: float = 0.0
    reused: bool = False


class RecordingProgress:
    """A ``Progress`` that records, and tells ``inner`` the same."""

    def __init__(self, inner: Progress) -> None:
        self._inner = inner
        self._began = time.perf_counter()
        self.stages: list[StageTime] = []
        self.notes: list[str] = []
        self.warnings: list[str] = []
        self.stage_warnings: list[str] = []

    def stage(self, name: str) -> None:
        """Close the stage before and begin ``name``."""
        self.end_stage()
        self.stages.append(StageTime(name))
        self.stage_warnings = []
        self._began = time.perf_counter()
        _log.info("stage %s", name)
        self._inner.stage(name)

    def end_stage(self) -> None:
        """Close the stage that is running, if any; a stage told twice adds up."""
        if self.stages:
            now = time.perf_counter()
            if not self.stages[-1].reused:
                self.stages[-1].seconds += now - self._began
            self._began = now

    def reuse(self, seconds: float) -> None:
        """The stage that is running takes over an earlier result, which took ``seconds``."""
        self.stages[-1].seconds, self.stages[-1].reused = seconds, True

    def update(self, done: float, total: float, text: str = "") -> None:
        """Pass on; too frequent for the log."""
        self._inner.update(done, total, text)

    def note(self, text: str) -> None:
        """Keep and log a note."""
        self.notes.append(text)
        _log.info(text)
        self._inner.note(text)

    def warn(self, text: str) -> None:
        """Keep and log a warning; the same words are said once."""
        if text not in self.stage_warnings:
            self.stage_warnings.append(text)
        if text not in self.warnings:
            self.warnings.append(text)
            _log.warning(text)
            self._inner.warn(text)
