"""What a splat file or a run folder holds, in numbers: ``phys4dgen inspect``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from phys4dgen.errors import RunError
from phys4dgen.formats import read_splat_file
from phys4dgen.run.folder import finished_stages

__all__ = ["inspect_path"]

_NEAR_INVISIBLE = 0.1
"""Captures hold 23-46 % of Gaussians below this opacity; many more hint at a damaged export."""


def inspect_path(path: Path) -> dict[str, Any]:
    """Facts about a splat file or a run folder, ready for JSON.

    Raises:
        FormatError: the file is no splat that this version reads.
        RunError: the folder holds no run.
    """
    return _inspect_run(path) if path.is_dir() else _inspect_splat(path)


def _inspect_splat(path: Path) -> dict[str, Any]:
    splat = read_splat_file(path)
    gaussians = splat.gaussians
    lower, upper = gaussians.robust_bounds()
    opacity = np.percentile(gaussians.opacities, [5, 50, 95])
    longest = gaussians.scales.max(axis=1)
    return {
        "kind": "splat",
        "file": str(path),
        "bytes": path.stat().st_size,
        "layout": splat.layout,
        "gaussians": len(gaussians),
        "sh_degree": gaussians.sh_degree,
        "robust_box": {"lower": lower.tolist(), "upper": upper.tolist(), "extent": (upper - lower).tolist()},
        "centre": ((lower + upper) / 2).tolist(),
        "opacity_percentiles": dict(zip(("5", "50", "95"), opacity.round(4).tolist(), strict=True)),
        "share_below_opacity_0.1": float((gaussians.opacities < _NEAR_INVISIBLE).mean()),
        "median_longest_scale": float(np.median(longest)),
        "extra_columns": sorted(splat.extra),
        "problems": [*splat.notes, *_problems(gaussians.opacities, longest, float((upper - lower).max()))],
    }


def _problems(opacities: Any, longest_scale: Any, extent: float) -> list[str]:
    """What would spoil a simulation or a picture."""
    found = []
    invisible = float((opacities < _NEAR_INVISIBLE).mean())
    if invisible > 0.7:
        found.append(f"{invisible:.0%} of the Gaussians have an opacity below 0.1; was the file trained to the end?")
    giants = int((longest_scale > 0.5 * extent).sum())
    if giants:
        found.append(f"{giants} Gaussians are longer than half the object; crop the background away.")
    return found


def _inspect_run(folder: Path) -> dict[str, Any]:
    report = folder / "report.json"
    finished = finished_stages(folder)
    if not finished:
        raise RunError(f"{folder}: expected a splat file or a run folder, got a folder without a run of phys4dgen.")
    return {
        "kind": "run",
        "folder": str(folder),
        "finished": finished,
        "files": sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")),
        "report": json.loads(report.read_text("utf-8")) if report.is_file() else None,
    }
