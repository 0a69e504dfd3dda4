"""Contacts on the grid: nodes whose velocity the ground, a held or driven part or an obstacle limits, row by row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.kernels.contact import SEPARATE, SLIP, STICKY

__all__ = ["CONTACT_KINDS", "GROUND_GAP_CELLS", "Entries", "contact_arrays", "ground_nodes"]

CONTACT_KINDS = {"separate": SEPARATE, "slip": SLIP, "sticky": STICKY}

GROUND_GAP_CELLS = 0.7
"""How far the highest nodes that the ground stops lie below it."""

_GROUND_LAYERS = 4  # no particle above the ground's nodes reaches farther down

Entries = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]
"""World nodes [K, 3]; (kind, whether rigid parts meet it by themselves, number or -1, velocity field or -1 for all)
[K, 4]; (outward normal 3, friction, velocity 3) [K, 7]."""


def ground_nodes(
    highest: int,
    kind: int,
    friction: float,
    number: int,
    *,
    shift: NDArray[np.int64],
    nodes: tuple[int, int, int],
) -> Entries:
    """The ground's nodes in a grid of ``nodes`` whose first is the world node ``shift``; ``highest`` is their top z."""
    z = np.arange(max(highest - _GROUND_LAYERS + 1, shift[2]), min(highest + 1, shift[2] + nodes[2]))
    x, y = np.arange(nodes[0]) + shift[0], np.arange(nodes[1]) + shift[1]
    places = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    kinds = np.tile(np.array([kind, 1, number, -1], np.int32), (len(places), 1))
    planes = np.tile(np.array([0, 0, 1, friction, 0, 0, 0], np.float32), (len(places), 1))
    return places, kinds, planes


def contact_arrays(
    entries: list[Entries], *, shift: NDArray[np.int64], nodes: tuple[int, int, int], fields: int
) -> tuple[NDArray[Any], ...]:
    """Contacts of one grid with so many velocity ``fields`` as the kernels read them.

    Returns:
        (first contact of each row, int32 [nx ny + 1]; (z, kind, whether rigid parts meet it by themselves, number,
        field or -1) of each, int32 [K, 5]; outward normal, friction and velocity, float32 [K, 7]; impulses at each in
        each field, zero, float32 [fields, K, 3], in mean particle masses times m/s; friction of each field at each and
        the rate in 1/s at which viscosity slows what slides, zero, float32 [fields, K, 2]), within a row in the order
        of ``entries``.
    """
    places = np.concatenate([np.zeros((0, 3), np.int64), *(e[0] for e in entries)]) - shift
    kinds = np.concatenate([np.zeros((0, 4), np.int32), *(e[1] for e in entries)])
    planes = np.concatenate([np.zeros((0, 7), np.float32), *(e[2] for e in entries)])
    inside = ((places >= 0) & (places < nodes)).all(1)
    row = places[inside, 0] * nodes[1] + places[inside, 1]
    order = np.argsort(row, kind="stable")
    starts = np.searchsorted(row[order], np.arange(nodes[0] * nodes[1] + 1)).astype(np.int32)
    table = np.column_stack([places[inside, 2], kinds[inside]])[order].astype(np.int32)
    planes = np.ascontiguousarray(planes[inside][order])
    rubbing = np.zeros((fields, len(order), 2), np.float32)
    rubbing[..., 0] = planes[:, 3]
    return starts, table, planes, np.zeros((fields, len(order), 3), np.float32), rubbing
