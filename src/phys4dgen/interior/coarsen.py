"""A coarser set of particles of the same body, for the probe that runs before the film."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import Continuum, Frame

__all__ = ["coarsened"]


def coarsened(continuum: Continuum, *, frame: Frame, factor: int) -> tuple[Continuum, NDArray[np.bool_]]:
    """Keep one site (with all its layers or strands) per cube of ``factor`` spacings and part; volumes add up.

    Args:
        continuum: particles.
        frame: input coordinates -> metres.
        factor: how many times wider the spacing becomes.

    Returns:
        The coarser continuum, and which of the particles it kept, [P].
    """
    middle_m = frame.to_metres(continuum.positions) - continuum.offset_m
    side = continuum.spacing_m * factor
    cube = np.floor((middle_m - middle_m.min(0)) / side).astype(np.int64)
    keys = np.column_stack([cube, continuum.part, continuum.shape])
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    count = np.bincount(group)
    center = np.stack([np.bincount(group, middle_m[:, a]) for a in range(3)], 1) / count[:, None]
    far = np.linalg.norm(middle_m - center[group], axis=1)
    # Layers and strands of one site share its middle to the last digit that matters: they are nearest together.
    site = np.unique(np.round(middle_m / (1e-3 * continuum.spacing_m)).astype(np.int64), axis=0, return_inverse=True)[1]
    site = site.reshape(-1)
    order = np.lexsort((site, far, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    chosen_site = np.zeros(len(count), np.int64)
    chosen_site[group[order][first]] = site[order][first]
    keep = site == chosen_site[group]
    total = np.bincount(group, continuum.volume_m3)
    kept = np.bincount(group, continuum.volume_m3 * keep)
    fields = ("positions", "part", "is_interior", "gaussian_index", "piece", "shape", "thickness_m")
    coarse = replace(
        continuum,
        **{name: getattr(continuum, name)[keep] for name in (*fields, "thickness_measured", "offset_m")},
        volume_m3=(continuum.volume_m3 * (total / np.maximum(kept, 1e-300))[group])[keep],
        spacing_m=side,
    )
    return coarse, keep
