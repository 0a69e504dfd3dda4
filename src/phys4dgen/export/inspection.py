"""What a splat file holds, as plain facts for people and for ``inspect FILE --json``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.formats import read_splat_file
from phys4dgen.types import SH_C0, Gaussians
from phys4dgen.upright import guess_up

__all__ = ["inspect_splat", "rounded"]

QUANTILES = (0.0, 0.01, 0.25, 0.5, 0.75, 0.99, 1.0)
FLOATER_DISTANCE = 2.0
"""A Gaussian further outside the robust box than this many of its longest sides is a floater."""


def inspect_splat(path: Path | str) -> dict[str, Any]:
    """Facts about a splat file; every value is a plain Python number, string, list or dict, in input units.

    Raises:
        FormatError: the file cannot be read (see ``load_gaussians``).
    """
    splat = read_splat_file(path)
    gaussians = splat.gaussians
    lower, upper = gaussians.robust_bounds()
    up = guess_up(gaussians)
    colors = 0.5 + SH_C0 * gaussians.sh[:, 0]
    return {
        "file": str(path),
        "bytes": Path(path).stat().st_size,
        "layout": splat.layout,
        "count": len(gaussians),
        "sh_degree": gaussians.sh_degree,
        "extra_properties": {name: values.dtype.name for name, values in splat.extra.items()},
        "bounds": {
            "robust_lower": rounded(lower),
            "robust_upper": rounded(upper),
            "robust_extent": rounded(upper - lower),
            "full_lower": rounded(gaussians.means.min(axis=0)),
            "full_upper": rounded(gaussians.means.max(axis=0)),
            "quantiles": {axis: rounded(np.quantile(gaussians.means[:, i], QUANTILES)) for i, axis in enumerate("xyz")},
        },
        "up": {
            "vector": rounded(up.up),
            "confidence": round(up.confidence, 3),
            "sure": up.is_sure,
            "reason": up.reason,
        },
        "opacity": {
            "quantiles": quantiles(gaussians.opacities),
            "share_below_0.1": round(float((gaussians.opacities < 0.1).mean()), 4),
        },
        "scale": {"quantiles": quantiles(gaussians.scales)},
        "color": {
            "min": rounded(colors.min(axis=0)),
            "max": rounded(colors.max(axis=0)),
            "share_outside_0_1": round(float(((colors < 0) | (colors > 1)).any(axis=1).mean()), 4),
        },
        "problems": [*splat.notes, *problems(gaussians, lower, upper)],
    }


def problems(gaussians: Gaussians, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> list[str]:
    """What may spoil a simulation or a picture, one sentence each; empty for a clean file."""
    n, longest = len(gaussians), float((upper - lower).max())
    found = []
    duplicates = n - distinct_rows(gaussians)
    if duplicates:
        found.append(f"{duplicates} of {n} Gaussians repeat another one exactly.")
    if longest <= 0:
        return [*found, "All Gaussians lie at one point, so the object has no size."]
    outside = np.maximum(lower - gaussians.means, gaussians.means - upper).max(axis=1)
    far = int((outside > FLOATER_DISTANCE * longest).sum())
    if far:
        found.append(
            f"{far} of {n} Gaussians float more than {FLOATER_DISTANCE:g} object sizes away, the furthest "
            f"{float(outside.max()) / longest:.3g}."
        )
    large = int((gaussians.scales.max(axis=1) > 0.5 * longest).sum())
    if large:
        found.append(f"{large} of {n} Gaussians have a standard deviation above half the object's size.")
    return found


def distinct_rows(gaussians: Gaussians) -> int:
    """Number of Gaussians that differ in centre, shape, opacity or base colour."""
    columns = (
        gaussians.means,
        gaussians.quats_wxyz,
        gaussians.scales,
        gaussians.opacities[:, None],
        gaussians.sh[:, 0],
    )
    table = np.ascontiguousarray(np.concatenate(columns, axis=1))
    return len(np.unique(table.view(np.dtype((np.void, table.itemsize * table.shape[1])))))


def quantiles(values: NDArray[np.float32]) -> dict[str, float]:
    """Values at QUANTILES by name."""
    return dict(zip(map(str, QUANTILES), rounded(np.quantile(values, QUANTILES)), strict=True))


def rounded(values: NDArray[Any]) -> list[float]:
    """Plain numbers of 6 significant digits."""
    return [float(f"{value:.6g}") for value in values.tolist()]
