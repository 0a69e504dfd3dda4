"""``log.jsonl``: one JSON object per line and record, appended over all runs in the folder."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from pathlib import Path

from phys4dgen.run.json_text import json_text

__all__ = ["JsonLinesHandler"]


class JsonLinesHandler(logging.FileHandler):
    """Writes records with time, level, logger, message and, where there is one, the traceback."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.setLevel(logging.DEBUG)

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line of JSON."""
        entry = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            entry["traceback"] = logging.Formatter().formatException(record.exc_info)
        return json_text(entry)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802  the name is logging's
        """Say nothing: a disk that is full for the log is full for what matters more, which says so itself."""
