"""The paper's particles: every Gaussian at the surface is one, and the interior cells of the label grid are the others.

Paper: Sec. 3.3, "P = {Gaussians} u {internal particles}". It leaves the volumes open; here they are those of the solid
that was found, so that the mass does not depend on how many Gaussians a capture has: what the solid holds in one grid
cell is shared by the particles in it. Thin parts are what the Gaussians make of them, without layers or strands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.labels import LabelGrid
from phys4dgen.types import SOLID, Continuum, Frame, Gaussians

__all__ = ["as_lumps", "gaussians_as_particles"]

_REACH_CELLS = 1.5
"""Gaussians farther from the solid share no grid node with it: they would fly off, and are carried instead."""
_LEAST_SHARE = 1e-3
"""Of a seeded particle's mean volume: no particle is without mass."""


def gaussians_as_particles(
    gaussians: Gaussians,
    labels: NDArray[np.int32],
    seeded: Continuum,
    *,
    labelled: LabelGrid,
    frame: Frame,
    cell: float,
) -> Continuum:
    """The particles of the paper in the place of the seeded ones.

    Args:
        gaussians: N Gaussians, of any opacity.
        labels: part of each, [N].
        seeded: the well-spaced particles of the same solid: their volumes, parts, pieces and what is known of thin
            parts are taken over; materials are named by it (``as_lumps`` takes it away for the simulation).
        labelled: the label grid; its interior cells become particles.
        frame: input coordinates -> metres.
        cell: grid cell dx of the simulation, input units.
    """
    means = gaussians.means.astype(np.float64)
    body = KDTree(seeded.positions)
    distance, _ = body.query(means, distance_upper_bound=_REACH_CELLS * cell, workers=-1)
    index = np.flatnonzero(np.isfinite(distance))
    cells = np.argwhere(labelled.is_interior)
    inside = labelled.grid.centers(cells) @ frame.rotation
    positions = np.concatenate([means[index], inside]).astype(np.float32).astype(np.float64)
    part = np.concatenate([labels[index], labelled.part[tuple(cells.T)]]).astype(np.int32)
    is_interior = np.arange(len(part)) >= len(index)
    p = len(part)
    piece, shape = np.zeros(p, np.int32), np.full(p, SOLID, np.int8)
    thickness_m, measured = np.full(p, np.nan), np.zeros(p, bool)
    for number in np.unique(part):
        mine, theirs = np.flatnonzero(part == number), np.flatnonzero(seeded.part == number)
        if len(theirs):
            _, nearest = KDTree(seeded.positions[theirs]).query(positions[mine], workers=-1)
            like = theirs[nearest]
            piece[mine], shape[mine] = seeded.piece[like], seeded.shape[like]
            thickness_m[mine], measured[mine] = seeded.thickness_m[like], seeded.thickness_measured[like]
    return replace(
        seeded,
        positions=positions,
        part=part,
        is_interior=is_interior,
        volume_m3=_shared_volume(positions, part, seeded, cell),
        gaussian_index=np.concatenate([index, np.full(len(cells), -1)]).astype(np.int32),
        piece=piece,
        shape=np.where(is_interior, SOLID, shape).astype(np.int8),
        thickness_m=np.where(is_interior, np.nan, thickness_m),
        thickness_measured=measured & ~is_interior,
        offset_m=np.zeros((p, 3)),
        site=np.arange(p, dtype=np.int32),
    )


def as_lumps(continuum: Continuum) -> Continuum:
    """The same particles without what is known of thin parts: so the paper simulates them."""
    p = len(continuum)
    return replace(
        continuum,
        shape=np.full(p, SOLID, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
    )


def _shared_volume(
    positions: NDArray[np.float64], part: NDArray[np.int32], seeded: Continuum, cell: float
) -> NDArray[np.float64]:
    """Volume of each particle, m3: what the seeded particles of its part have in its grid cell, shared evenly.

    A seeded particle in whose cell the part has no particle gives its volume to the nearest one of the part.
    """
    volume = np.zeros(len(part))
    lower = np.minimum(positions.min(0), seeded.positions.min(0))
    for number in np.unique(seeded.part):
        theirs = np.flatnonzero(seeded.part == number)
        mine = np.flatnonzero(part == number)
        if len(mine) == 0:  # its volume would be lost: the nearest particles of any part take it
            mine = np.arange(len(part))
        places = np.floor((np.concatenate([positions[mine], seeded.positions[theirs]]) - lower) / cell).astype(np.int64)
        _, where = np.unique(places, axis=0, return_inverse=True)
        where = where.ravel()
        here, there = where[: len(mine)], where[len(mine) :]
        held = np.bincount(there, seeded.volume_m3[theirs], where.max() + 1)
        count = np.bincount(here, minlength=where.max() + 1)
        volume[mine] += held[here] / count[here]
        alone = theirs[count[there] == 0]
        if len(alone):
            _, nearest = KDTree(positions[mine]).query(seeded.positions[alone], workers=-1)
            np.add.at(volume, mine[nearest], seeded.volume_m3[alone])
    total = volume.sum()
    volume = np.maximum(volume, _LEAST_SHARE * seeded.volume_m3.mean())
    return volume * (total / volume.sum())
