"""What is joined to what: free particles with held ones, parts that are one rigid body, soft matter with rigid.

A capture does not say whether a leaf that lies at a pot grows out of it. What grows out of something leaves its
surface, and what hangs beside it runs along it: a place of contact is a root if the material there goes on along the
outward normal of the held surface, or if it is all that joins the piece to anything held.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

__all__ = ["bonded_to_held", "joining_masses", "rigid_bodies"]

_REACH_CELLS = 2.5
"""Particles farther apart share no node of the grid."""

_LINK_CELLS = 0.9
"""Neighbours in one piece stand half a cell apart, somewhat more in sheets and over bridges."""

_SCATTER_CELLS = 3.0
"""Pieces of a rigid part that a capture has torn lie closer than this; lumps farther apart (coals) are bodies apart."""

_SHARED_CELLS = 1.5
_MOST_MOVED = 0.5
"""Of a rigid body's mass: more is not moved to its joints."""

_TOUCH_CELLS = 1.0
_ONWARD_CELLS = 5.0
_ROOT_COSINE = 0.5
_JOINT_PAIRS = 3


def bonded_to_held(
    positions_m: NDArray[np.float64], held: NDArray[np.bool_], *, piece: NDArray[np.int64], cell_m: float
) -> NDArray[np.bool_]:
    """Which particles, where they are near held ones, have grown together with them, [P].

    Args:
        positions_m: at rest, [P, 3].
        held: particles that do not move, [P].
        piece: number of the connected piece of its part that each particle belongs to, unique over all parts, [P].
        cell_m: grid cell dx, m.
    """
    bonded = np.ones(len(held), np.bool_)
    free, still = np.flatnonzero(~held), np.flatnonzero(held)
    if len(free) == 0 or len(still) == 0:
        return bonded
    surface = KDTree(positions_m[still])
    distance, nearest = surface.query(positions_m[free], distance_upper_bound=_REACH_CELLS * cell_m)
    near = np.isfinite(distance)
    if not near.any():
        return bonded
    contact, contact_distance = free[near], distance[near]
    outward = positions_m[contact] - positions_m[still[np.asarray(nearest)[near]]]
    whole = _wholes(positions_m[free], piece[free], _LINK_CELLS * cell_m)[near]
    patch = _connected(positions_m[contact], _LINK_CELLS * cell_m, whole)
    rest = free[~near]
    beyond = KDTree(positions_m[rest]) if len(rest) else None
    size = np.bincount(patch)
    owner = whole[np.unique(patch, return_index=True)[1]]
    rooted, touching = np.zeros(len(size), np.bool_), np.zeros(len(size), np.bool_)
    for number in range(len(size)):
        mine = patch == number
        centre = positions_m[contact[mine]].mean(0)
        touching[number] = contact_distance[mine].min() < _TOUCH_CELLS * cell_m
        if touching[number]:
            rooted[number] = _leaves(centre, outward[mine].mean(0), positions_m, rest, beyond, cell_m)
    for own in np.unique(owner):
        places = np.flatnonzero((owner == own) & touching)
        if len(places) and not rooted[places].any():
            rooted[places[size[places].argmax()]] = True
    bonded[contact] = rooted[patch]
    return bonded


def _leaves(
    centre: NDArray[np.float64],
    normal: NDArray[np.float64],
    positions_m: NDArray[np.float64],
    rest: NDArray[np.intp],
    beyond: KDTree | None,
    cell_m: float,
) -> bool:
    """Whether what goes on from a place of contact goes away from the held surface."""
    if beyond is None:
        return True
    onward = beyond.query_ball_point(centre, _ONWARD_CELLS * cell_m)
    if not onward:
        return False
    way = positions_m[rest[onward]].mean(0) - centre
    return float(way @ normal) > _ROOT_COSINE * float(np.linalg.norm(way) * np.linalg.norm(normal))


def rigid_bodies(
    positions_m: NDArray[np.float64],
    part: NDArray[np.int32],
    *,
    rigid_parts: Iterable[int],
    held: NDArray[np.bool_],
    cell_m: float,
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Rigid parts as bodies: lumps that touch are one, and those that touch something held are held.

    Args:
        positions_m: at rest, [P, 3].
        part: part number of each particle, [P].
        rigid_parts: parts that do not deform.
        held: particles that do not move, [P].
        cell_m: grid cell dx, m.

    Returns:
        Body of each particle, -1 where it is not rigid or is held, [P]; and the rigid particles that are held, [P].
    """
    body, stuck = np.full(len(part), -1, np.int32), np.zeros(len(part), np.bool_)
    rigid = np.flatnonzero(np.isin(part, list(rigid_parts)) & ~held)
    if len(rigid) == 0:
        return body, stuck
    # Node 0 stands for all that is held.
    member = np.zeros(len(part), np.int64)
    member[rigid] = 1 + _lumps(positions_m[rigid], part[rigid], _SCATTER_CELLS * cell_m)
    chosen = np.flatnonzero((member > 0) | held)
    pairs = KDTree(positions_m[chosen]).query_pairs(_TOUCH_CELLS * cell_m, output_type="ndarray")
    a, b = member[chosen[pairs[:, 0]]], member[chosen[pairs[:, 1]]]
    count = int(member.max()) + 1
    touching = sparse.coo_matrix((np.ones(len(pairs)), (a, b)), shape=(count, count)).tocsr()
    touching = touching + touching.T
    touching.data[touching.data < _JOINT_PAIRS] = 0
    touching.eliminate_zeros()
    _, joined = connected_components(touching, directed=False)
    if held.any():
        stuck[rigid] = joined[member[rigid]] == joined[0]
    free = rigid[~stuck[rigid]]
    body[free] = np.unique(joined[member[free]], return_inverse=True)[1]
    return body, stuck


def _lumps(points: NDArray[np.float64], part: NDArray[np.int32], reach: float) -> NDArray[np.int64]:
    """Number of the lump of each point: what lies within about ``reach`` of each other in one part.

    Points are gathered into cubes of half the reach first; all pairs within several cells would be too many.
    """
    cubes = np.column_stack([part, np.floor(points / (0.5 * reach))]).astype(np.int64)
    places, cube = np.unique(cubes, axis=0, return_inverse=True)
    return _connected(places[:, 1:].astype(np.float64), 2.0, places[:, 0])[cube.ravel()].astype(np.int64)


def _wholes(points: NDArray[np.float64], piece: NDArray[np.int64], reach: float) -> NDArray[np.int32]:
    """What hangs together across parts: pieces, and neighbours of any part."""
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    _, first, number = np.unique(piece, return_index=True, return_inverse=True)
    start = np.concatenate([pairs[:, 0], np.arange(len(points))])
    end = np.concatenate([pairs[:, 1], first[number]])
    graph = sparse.coo_matrix((np.ones(len(start)), (start, end)), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]


def _connected(points: NDArray[np.float64], reach: float, label: NDArray[Any]) -> NDArray[np.int32]:
    """Connected component of each point within its label."""
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]]
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]


def joining_masses(
    positions_m: NDArray[np.float64],
    mass_kg: NDArray[np.float64],
    *,
    rigid_body: NDArray[np.int32],
    apart: NDArray[np.int32],
    hangs: NDArray[np.bool_],
    cell_m: float,
) -> NDArray[np.float64]:
    """Masses with which rigid particles hold what is soft beside them, [P]; each rigid body keeps its own.

    On the grid a particle speaks with its mass. A rigid particle that is lighter than its soft neighbours (the skin of
    a balloon at its string) is outvoted at their nodes and lets go, though its body is heavy: a rod on particles of a
    third of its own particles' mass tore off at once, on equally heavy ones it carried the load. So those at a joint
    become as heavy as the heaviest soft neighbour, and the others of their body lighter.

    Args:
        positions_m: at rest, [P, 3].
        mass_kg: as simulated, [P].
        rigid_body: number of the rigid body of each particle, -1 if it has none, [P].
        apart: what has another number here only touches, and holds nothing (``Body.body_id``), [P].
        hangs: particles that a rigid one may have to hold: they move, and are solid, [P].
        cell_m: grid cell dx, m.
    """
    soft, rigid = np.flatnonzero((rigid_body < 0) & hangs), np.flatnonzero(rigid_body >= 0)
    joined = mass_kg.copy()
    if len(soft) == 0 or len(rigid) == 0:
        return joined
    wanted = np.zeros(len(rigid))
    for body in np.unique(apart[rigid]):
        own, others = np.flatnonzero(apart[rigid] == body), soft[apart[soft] == body]
        if len(others) == 0:
            continue
        near = KDTree(positions_m[rigid[own]]).query_ball_tree(KDTree(positions_m[others]), _SHARED_CELLS * cell_m)
        wanted[own] = [mass_kg[others[found]].max() if found else 0.0 for found in near]
    for number in np.unique(rigid_body[rigid]):
        own = rigid_body[rigid] == number
        members, before = rigid[own], mass_kg[rigid[own]]
        missing = np.maximum(wanted[own] - before, 0)
        givers = missing == 0
        most = _MOST_MOVED * before[givers].sum()
        if missing.sum() == 0 or most == 0:
            continue
        missing *= min(1.0, most / missing.sum())
        joined[members] = np.where(givers, before * (1 - missing.sum() / before[givers].sum()), before + missing)
    return joined
