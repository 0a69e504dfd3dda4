"""What a splat file or a run folder holds: ``phys4dgen inspect``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError
from phys4dgen.export.inspection import inspect_splat
from phys4dgen.run.state import finished_stages, read_state

__all__ = ["inspect_path"]


def inspect_path(path: Path) -> dict[str, Any]:
    """Facts about a splat file or a run folder, ready for JSON.

    Raises:
        FormatError: the file is no splat that this version reads.
        RunError: the folder holds no run.
    """
    return {"kind": "run", **_inspect_run(path)} if path.is_dir() else {"kind": "splat", **inspect_splat(path)}


def _inspect_run(folder: Path) -> dict[str, Any]:
    made, finished = list(read_state(folder)), finished_stages(folder)
    if not made:
        raise RunError(f"{folder}: expected a splat file or a run folder, got a folder without a run of phys4dgen.")
    report = folder / "report.json"
    return {
        "folder": str(folder),
        "finished": finished,
        "out_of_date": [stage for stage in made if stage not in finished],
        "files": sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")),
        "report": json.loads(report.read_text("utf-8")) if report.is_file() else None,
    }
