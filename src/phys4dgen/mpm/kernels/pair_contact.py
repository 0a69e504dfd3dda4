"""Contact between bodies with velocity fields of their own, at the grid nodes that they share.

Between two sorts every shared node of two fields keeps a plane that parts them: its normal, and the gap that is left
between the particles on either side. The relative velocity of the two fields at the node may close the gap, but no more
than that within a substep; what it loses beyond is the impulse, and friction along the plane stays in its Coulomb cone.
Both fields take their share by mass, so momentum is kept.

Sources: S. G. Bardenhagen et al., *An improved contact algorithm for the material point method*, CMES 2 (2001) 509-522
(fields and impulses); the planes are found from the particles, since grids alone see a contact up to two cells early.
"""

from __future__ import annotations

import math

import numpy as np
from numba.core import types

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.layout import MASS, POSITION, VOLUME, inner_kernel, strict_kernel

__all__ = [
    "CANDIDATES",
    "MOMENTS",
    "PAIRS",
    "address_of_limit_pairs",
    "call_limit_pairs",
    "field_moments",
    "list_particles",
    "widest_gaps",
]

CANDIDATES = 4
"""Normals that the search at each node begins with."""
MOMENTS = 8
"""Volume, its gradient (3) and its first moment about the node (3), in cells, and volume of fluid."""

_WIDEST_TILT, _FINEST_TILT = 0.6, 0.015  # of the search for the widest gap, rad
_PUSH_OUT = 0.1  # share of an overlap that is undone per substep,
_FASTEST_PUSH = 0.25  # no faster than this share of the velocity that loads add: more keeps stacks trembling
_LEAST_MASS = np.float32(1e-9)  # of the mean particle mass


@strict_kernel
def _lowest_and_weights(particles, p, inverse_dx, first, node, weights, slopes, offsets):
    """Lowest node of a particle counted from ``first``, weights, their slopes, and node minus particle, by axis."""
    for axis in range(3):
        place = particles[POSITION + axis, p] * inverse_dx
        below = math.floor(place - 0.5)
        node[axis] = int(below) - first[axis]
        u = place - below - 1
        weights[axis, 0], weights[axis, 1], weights[axis, 2] = 0.5 * (0.5 - u) ** 2, 0.75 - u * u, 0.5 * (0.5 + u) ** 2
        slopes[axis, 0], slopes[axis, 1], slopes[axis, 2] = 0.5 - u, 2 * u, -0.5 - u
        offsets[axis, 0], offsets[axis, 1], offsets[axis, 2] = -1 - u, -u, 1 - u


@strict_kernel
def field_moments(particles, field_of, is_fluid, inverse_dx, mass_unit, first, moments):
    """Add up where the volume of each field lies around the nodes of a box.

    Args:
        particles: columns of ``layout``, float32 [columns, stride].
        field_of: velocity field of each particle, int32 [stride].
        is_fluid: 1 for particles of fluids, else 0, float32 [stride].
        inverse_dx: cells per metre.
        mass_unit: mean particle mass, kg.
        first: world node of the box's first node, int64 [3].
        moments: result, added to, float32 [fields, nx, ny, nz, MOMENTS]; volumes in cells.
    """
    weights, slopes, offsets = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    node = np.zeros(3, np.int64)
    cells = mass_unit * inverse_dx * inverse_dx * inverse_dx
    nx, ny, nz = moments.shape[1], moments.shape[2], moments.shape[3]
    for p in range(particles.shape[1]):
        if not particles[MASS, p] > 0:
            continue
        _lowest_and_weights(particles, p, inverse_dx, first, node, weights, slopes, offsets)
        if not (-3 < node[0] < nx and -3 < node[1] < ny and -3 < node[2] < nz):
            continue
        volume = particles[VOLUME, p] * cells
        own = moments[field_of[p]]
        for i in range(max(0, -node[0]), min(3, nx - node[0])):
            for j in range(max(0, -node[1]), min(3, ny - node[1])):
                for k in range(max(0, -node[2]), min(3, nz - node[2])):
                    wx, wy, wz = weights[0, i], weights[1, j], weights[2, k]
                    share = volume * wx * wy * wz
                    here = own[node[0] + i, node[1] + j, node[2] + k]
                    here[0] += share
                    # the weight falls where the particle moves away from the node: d/dx_node = - d/dx_particle
                    here[1] += volume * slopes[0, i] * wy * wz
                    here[2] += volume * wx * slopes[1, j] * wz
                    here[3] += volume * wx * wy * slopes[2, k]
                    here[4] -= share * offsets[0, i]
                    here[5] -= share * offsets[1, j]
                    here[6] -= share * offsets[2, k]
                    here[7] += share * is_fluid[p]


@strict_kernel
def list_particles(particles, inverse_dx, first, slots, starts, members):
    """List the particles around each of M nodes of a box, or only count them where ``members`` is empty.

    Args:
        particles: as ``field_moments``.
        inverse_dx: as ``field_moments``.
        first: as ``field_moments``.
        slots: number of each node in the list, -1 where it is not asked for, int32 [nx, ny, nz].
        starts: place of each node's next particle in ``members``, moved on, or its count, int64 [M].
        members: result, places of particles, int32.
    """
    weights, slopes, offsets = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    node = np.zeros(3, np.int64)
    nx, ny, nz = slots.shape
    for p in range(particles.shape[1]):
        if not particles[MASS, p] > 0:
            continue
        _lowest_and_weights(particles, p, inverse_dx, first, node, weights, slopes, offsets)
        if not (-3 < node[0] < nx and -3 < node[1] < ny and -3 < node[2] < nz):
            continue
        for i in range(max(0, -node[0]), min(3, nx - node[0])):
            for j in range(max(0, -node[1]), min(3, ny - node[1])):
                for k in range(max(0, -node[2]), min(3, nz - node[2])):
                    slot = slots[node[0] + i, node[1] + j, node[2] + k]
                    if slot < 0:
                        continue
                    if len(members) > 0:
                        members[starts[slot]] = p
                    starts[slot] += 1


@strict_kernel
def _gap(n, upper, lower):
    """Distance between the points [A, 4] and [B, 4] (place and radius) along a direction; negative: overlap."""
    top = -math.inf
    for i in range(len(lower)):
        top = max(top, n[0] * lower[i, 0] + n[1] * lower[i, 1] + n[2] * lower[i, 2] + lower[i, 3])
    bottom = math.inf
    for i in range(len(upper)):
        bottom = min(bottom, n[0] * upper[i, 0] + n[1] * upper[i, 1] + n[2] * upper[i, 2] - upper[i, 3])
    return bottom - top


@strict_kernel
def _set_tilted(n, turn, angle, result):
    """``result`` [3] = a unit vector tilted by an angle to one of four sides."""
    axis = 0 if abs(n[0]) < 0.7 else 1
    t = np.zeros(3)
    t[axis] = 1.0
    for k in range(3):
        t[k] -= n[axis] * n[k]
    length = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    if turn >= 2:
        x, y, z = n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]
        t[0], t[1], t[2] = x, y, z
    side = math.sin(angle) * (1.0 if turn % 2 == 0 else -1.0) / length
    for k in range(3):
        result[k] = math.cos(angle) * n[k] + side * t[k]


@strict_kernel
def widest_gaps(particles, field_of, inverse_dx, mass_unit, nodes, slots, starts, members, pairs, candidates, planes):
    """The plane with the widest gap between two fields around each shared node, by a pattern search over directions.

    Args:
        particles: as ``field_moments``.
        field_of: as ``field_moments``.
        inverse_dx: as ``field_moments``.
        mass_unit: as ``field_moments``.
        nodes: world node of each pair, int64 [K, 3].
        slots: number of its node in the list, int64 [K].
        starts: first of each node's particles in ``members`` and one past the last, int64 [M + 1].
        members: places of particles, int32.
        pairs: the two fields, int64 [K, 2].
        candidates: directions to begin with, from the first to the second field, float32 [K, CANDIDATES, 3].
        planes: result, unit normal and gap in cells, float32 [K, 4].
    """
    most = 1
    for m in range(len(starts) - 1):
        most = max(most, starts[m + 1] - starts[m])
    points = np.zeros((2, most, 4))
    best, tried = np.zeros(3), np.zeros(3)
    for pair in range(len(pairs)):
        counts = [0, 0]
        for m in range(starts[slots[pair]], starts[slots[pair] + 1]):
            p = members[m]
            side = 0 if field_of[p] == pairs[pair, 0] else 1 if field_of[p] == pairs[pair, 1] else 2
            if side < 2:
                point = points[side, counts[side]]
                for axis in range(3):
                    point[axis] = particles[POSITION + axis, p] * inverse_dx - nodes[pair, axis]
                point[3] = 0.5 * inverse_dx * (particles[VOLUME, p] * mass_unit) ** (1 / 3)
                counts[side] += 1
        lower, upper = points[0, : counts[0]], points[1, : counts[1]]
        gap = -math.inf
        for candidate in range(CANDIDATES):
            found = _gap(candidates[pair, candidate], upper, lower)
            if found > gap:
                gap = found
                best[:] = candidates[pair, candidate]
        angle = _WIDEST_TILT
        while angle > _FINEST_TILT:
            better = False
            for turn in range(4):
                _set_tilted(best, turn, angle, tried)
                found = _gap(tried, upper, lower)
                if found > gap + 1e-6:
                    gap = found
                    best[:] = tried
                    better = True
            if not better:
                angle *= 0.5
        length = math.sqrt(best[0] * best[0] + best[1] * best[1] + best[2] * best[2])
        for axis in range(3):
            planes[pair, axis] = best[axis] / length
        planes[pair, 3] = gap


@inner_kernel
def _limit_pairs(plane, nodes_x, velocity, unblocked, pairs, grid, resting, dt):
    """Let the fields of one plane of nodes not move into one another.

    Args:
        plane: node number along x.
        nodes_x: nodes along x of one field; field f begins with plane f nodes_x.
        velocity: as ``grid_plane``; changed.
        unblocked: as ``grid_plane``; changed alike.
        pairs: (first pair of each row, int32 [nx ny + 1]; (z, first field, second field) of each, int32 [K, 3]; normal
            from first to second and friction, float32 [K, 4]; gap in metres, float32 [K], kept up to date).
        grid: as ``grid_plane``.
        resting: velocity that uniform loads add in a substep, m/s.
        dt: substep, s.
    """
    starts, nodes, planes, gaps = pairs
    ny, nz = grid[3], grid[4]
    for row in range(ny):
        for pair in range(starts[plane * ny + row], starts[plane * ny + row + 1]):
            column, a, b = nodes[pair, 0], nodes[pair, 1], nodes[pair, 2]
            at_a = (((a * nodes_x + plane) * ny + row) * nz + column) * 4
            at_b = (((b * nodes_x + plane) * ny + row) * nz + column) * 4
            mass_a, mass_b = velocity[at_a + 3], velocity[at_b + 3]
            if not (mass_a > _LEAST_MASS and mass_b > _LEAST_MASS):
                continue
            nx_, ny_, nz_ = planes[pair, 0], planes[pair, 1], planes[pair, 2]
            rx = velocity[at_b] - velocity[at_a]
            ry = velocity[at_b + 1] - velocity[at_a + 1]
            rz = velocity[at_b + 2] - velocity[at_a + 2]
            apart = rx * nx_ + ry * ny_ + rz * nz_
            gap = gaps[pair]
            least = -gap / dt if gap > 0 else min(-_PUSH_OUT * gap / dt, _FASTEST_PUSH * resting)
            gained = least - apart
            if gained > 0:
                tx, ty, tz = rx - apart * nx_, ry - apart * ny_, rz - apart * nz_
                sliding = math.sqrt(tx * tx + ty * ty + tz * tz)
                lost = min(planes[pair, 3] * gained, sliding)
                share = lost / sliding if sliding > 0 else sliding
                to_b = mass_a / (mass_a + mass_b)
                for axis in range(3):
                    normal = planes[pair, axis]
                    along = (rx, ry, rz)[axis] - apart * normal
                    change = gained * normal - share * along
                    velocity[at_b + axis] += to_b * change
                    velocity[at_a + axis] -= (1 - to_b) * change
                    if len(unblocked) > 0:
                        unblocked[at_b + axis] += to_b * change
                        unblocked[at_a + axis] -= (1 - to_b) * change
                apart = least
            gaps[pair] = gap + apart * dt


PAIRS = types.Tuple(
    (
        types.Array(types.int32, 1, "C"),
        types.Array(types.int32, 2, "C"),
        types.Array(types.float32, 2, "C"),
        FLOATS,
    )
)
"""Type of ``pairs``."""

_ARGUMENTS = (
    types.int64,  # plane
    types.int64,  # nodes_x
    FLOATS,  # velocity
    FLOATS,  # unblocked
    PAIRS,
    types.UniTuple(types.int64, 5),  # grid
    types.float32,  # resting
    types.float32,  # dt
)

call_limit_pairs = caller_of(_ARGUMENTS)
"""Inside kernels: let the fields of a plane not move into one another, by the function at an address."""


def address_of_limit_pairs() -> int:
    """Address of what lets fields not move into one another; compiled or from Numba's cache at the first call."""
    return address_of(_limit_pairs, _ARGUMENTS)
