"""What a splat file or a run folder holds: ``phys4dgen inspect``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phys4dgen.errors import RunError, SceneError
from phys4dgen.export.inspection import inspect_splat, rounded
from phys4dgen.progress import SILENT
from phys4dgen.run.state import finished_stages, read_state
from phys4dgen.scene import Scene

__all__ = ["inspect_path"]


def inspect_path(
    path: Path, *, select: Mapping[str, tuple[Any, str]] | None = None, picture: Path | None = None
) -> dict[str, Any]:
    """Facts about a splat file or a run folder, ready for JSON.

    Args:
        path: the file or folder.
        select: what of a splat is to be looked at, key of the scene -> (value, the flag that gave it).
        picture: PNG of four views to make or replace.

    Raises:
        FormatError: the file is no splat that this version reads.
        RunError: the folder holds no run.
        SceneError: nothing is selected.
    """
    if path.is_dir():
        if select or picture is not None:
            raise SceneError("inspect: --select-... and --picture are for splat files; a run has views/ and parts.png.")
        return {"kind": "run", **_inspect_run(path)}
    facts = {"kind": "splat", **inspect_splat(path)}
    if select or picture is not None:
        facts["selected"] = _selected(path, select or {}, picture)
    return facts


def _selected(path: Path, select: Mapping[str, tuple[Any, str]], picture: Path | None) -> dict[str, Any]:
    """Number and box of what is selected, everything where nothing is said."""
    from phys4dgen.export.pictures import write_png
    from phys4dgen.stages.asset import load
    from phys4dgen.stages.reconstruct import source_of_splat
    from phys4dgen.stages.selection import Surroundings
    from phys4dgen.stages.selection_picture import selection_picture

    values = {key: value for key, (value, _) in select.items()}
    scene = Scene(input=path.absolute()).with_overrides(
        values, sources={key: flag for key, (_, flag) in select.items()}
    )
    scene = scene.with_paths_from(Path.cwd())
    asset = load(scene, source_of_splat(scene), SILENT)
    if picture is not None:
        everything = Surroundings(asset.whole, np.arange(len(asset.whole)), are_hidden=False)
        write_png(selection_picture(asset, asset.surroundings or everything), picture)
    lower, upper = asset.gaussians.robust_bounds()
    return {
        "count": len(asset.gaussians),
        "robust_lower": rounded(lower),
        "robust_upper": rounded(upper),
        "robust_extent": rounded(upper - lower),
        "up": rounded(asset.frame.up),
    }


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
