"""Particles at rest as a linear operator on displacements of the grid, and nodes that are parted between strands.

What one step of the particle pass does to small displacements, in float64 and with the nodes of each particle listed,
so that two strands of matter can have copies of a node that do not know of each other.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from phys4dgen.mpm.kernels.layout import kernel, parallel_kernel, strict_kernel

__all__ = ["part_nodes", "to_nodes", "to_particles"]


@strict_kernel
def part_nodes(order, starts, places, reach, loose, copies):
    """Number the copies of all nodes: particles around a node share one where near ones join them, link by link.

    Args:
        order: entries (27 times a particle, plus which of its nodes) by node, int64 [27 K].
        starts: first entry of each node in ``order``, and their number, int64 [N + 1].
        places: of the particles, in cells, [K, 3].
        reach: distance of near ones, cells.
        loose: particles that join all others around a node, bool [K].
        copies: result, the copy that each entry takes part in, numbered node by node, int32 [27 K].

    Returns:
        Number of copies.
    """
    most = 0
    for node in range(len(starts) - 1):
        most = max(most, starts[node + 1] - starts[node])
    rest, joined = np.zeros(most, np.int64), np.zeros(most, np.int64)
    count = 0
    for node in range(len(starts) - 1):
        left = starts[node + 1] - starts[node]
        for i in range(left):
            rest[i] = order[starts[node] + i]
        while left > 0:
            left -= 1
            joined[0], waiting = rest[left], 1
            while waiting > 0:  # the last one first: in dense matter a few reach everything
                waiting -= 1
                entry = joined[waiting]
                copies[entry] = count
                p, i = entry // 27, 0
                while i < left:
                    q, apart = rest[i] // 27, 0.0
                    for axis in range(3):
                        apart += (places[p, axis] - places[q, axis]) ** 2
                    if apart <= reach * reach or loose[p] or loose[q]:
                        joined[waiting] = rest[i]
                        waiting += 1
                        left -= 1
                        rest[i] = rest[left]
                    else:
                        i += 1
            count += 1
    return count


@parallel_kernel
def to_particles(values, copies, weights, offsets, mass, lame, inverse_dx, carried):
    """Read displacements of the nodes, and what each particle gives back for them.

    Args:
        values: displacement of each copy of a node, m, [n, 3].
        copies: the 27 copies that a particle takes part in, int32 [K, 27].
        weights: quadratic B-spline weights, [K, 3 nodes, 3 axes].
        offsets: of each particle from its central node, in cells, [K, 3].
        mass: any factor of the motion itself, [K].
        lame: lambda and mu times the volume, [K, 2].
        inverse_dx: cells per metre.
        carried: result: mass times displacement, then mass times dx times its gradient plus 4 V sigma / dx, [K, 12].
    """
    for p in prange(len(copies)):
        v0 = v1 = v2 = 0.0
        g00 = g01 = g02 = g10 = g11 = g12 = g20 = g21 = g22 = 0.0
        for i in range(3):
            x = i - 1 - offsets[p, 0]
            for j in range(3):
                y = j - 1 - offsets[p, 1]
                plane = weights[p, i, 0] * weights[p, j, 1]
                for k in range(3):
                    z = k - 1 - offsets[p, 2]
                    w = plane * weights[p, k, 2]
                    at = copies[p, 9 * i + 3 * j + k]
                    u0, u1, u2 = w * values[at, 0], w * values[at, 1], w * values[at, 2]
                    v0, v1, v2 = v0 + u0, v1 + u1, v2 + u2
                    g00, g01, g02 = g00 + u0 * x, g01 + u0 * y, g02 + u0 * z
                    g10, g11, g12 = g10 + u1 * x, g11 + u1 * y, g12 + u1 * z
                    g20, g21, g22 = g20 + u2 * x, g21 + u2 * y, g22 + u2 * z
        m, stress = 4 * mass[p], 16 * inverse_dx * inverse_dx
        lam, mu = stress * lame[p, 0], stress * lame[p, 1]
        pressure = lam * (g00 + g11 + g22)
        carried[p, 0], carried[p, 1], carried[p, 2] = mass[p] * v0, mass[p] * v1, mass[p] * v2
        carried[p, 3] = m * g00 + 2 * mu * g00 + pressure
        carried[p, 4] = m * g01 + mu * (g01 + g10)
        carried[p, 5] = m * g02 + mu * (g02 + g20)
        carried[p, 6] = m * g10 + mu * (g01 + g10)
        carried[p, 7] = m * g11 + 2 * mu * g11 + pressure
        carried[p, 8] = m * g12 + mu * (g12 + g21)
        carried[p, 9] = m * g20 + mu * (g02 + g20)
        carried[p, 10] = m * g21 + mu * (g12 + g21)
        carried[p, 11] = m * g22 + 2 * mu * g22 + pressure


@kernel
def to_nodes(carried, copies, weights, offsets, result):
    """Add what the particles give to each copy of a node.

    Args:
        carried: from ``to_particles``, [K, 12].
        copies: as there.
        weights: as there.
        offsets: as there.
        result: added to, [n, 3].
    """
    for p in range(len(copies)):
        for i in range(3):
            x = i - 1 - offsets[p, 0]
            for j in range(3):
                y = j - 1 - offsets[p, 1]
                plane = weights[p, i, 0] * weights[p, j, 1]
                row0 = carried[p, 0] + carried[p, 3] * x + carried[p, 4] * y
                row1 = carried[p, 1] + carried[p, 6] * x + carried[p, 7] * y
                row2 = carried[p, 2] + carried[p, 9] * x + carried[p, 10] * y
                for k in range(3):
                    z = k - 1 - offsets[p, 2]
                    w = plane * weights[p, k, 2]
                    at = copies[p, 9 * i + 3 * j + k]
                    result[at, 0] += w * (row0 + carried[p, 5] * z)
                    result[at, 1] += w * (row1 + carried[p, 8] * z)
                    result[at, 2] += w * (row2 + carried[p, 11] * z)
