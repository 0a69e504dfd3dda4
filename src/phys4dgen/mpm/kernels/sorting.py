"""Between segments: check every particle, and order the particles of each law by cell.

Comparisons instead of ``min`` and ``max`` and loops instead of slices: Numba takes a multiple of the time to compile
those, and each scene waits for these kernels once.
"""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm.kernels.layout import POSITION, VELOCITY, inner_kernel, strict_kernel

__all__ = ["NEVER_SEEN", "inspect_particles", "order_by_cell", "span_rows", "take_sorted"]

NEVER_SEEN = -(2**30)
"""In ``previous``: this particle has no earlier cell to be compared with."""

_FARTHEST = np.float32(2**22)  # cells from the origin; beyond it float32 cannot tell places inside a cell apart


@strict_kernel
def inspect_particles(particles, previous, inverse_dx, cells, extent):
    """Find each particle's lowest node in world cells; check that all are finite and that none ran too far.

    Args:
        particles: columns of ``layout``, float32 [columns, stride].
        previous: lowest nodes at the last call, int32 [3, stride], or NEVER_SEEN.
        inverse_dx: cells per metre, float32.
        cells: result, lowest node of each particle, int32 [3, stride].
        extent: result, smallest and largest lowest node along x, y, z, int64 [6].

    Returns:
        (first bad particle or -1, largest speed in m/s). A particle is bad when its position or velocity is not
        finite, or when it left the cells next to its previous one.
    """
    bad = -1
    fastest = np.float32(0)
    for axis in range(3):
        extent[2 * axis] = 2**30
        extent[2 * axis + 1] = -(2**30)
    for p in range(particles.shape[1]):
        sane = True
        squared = np.float32(0)
        for axis in range(3):
            v = particles[VELOCITY + axis, p]
            squared += v * v
            place = particles[POSITION + axis, p] * inverse_dx - np.float32(0.5)
            if not abs(place) < _FARTHEST:
                sane = False
                continue
            node = np.int64(np.floor(place))
            cells[axis, p] = node
            before = previous[axis, p]
            if before != NEVER_SEEN and abs(node - before) > 1:
                sane = False
            if node < extent[2 * axis]:
                extent[2 * axis] = node
            if node > extent[2 * axis + 1]:
                extent[2 * axis + 1] = node
        if not squared < np.float32(1e30):
            sane = False
        elif squared > fastest:
            fastest = squared
        if not sane and bad < 0:
            bad = p
    return bad, np.sqrt(fastest)


@strict_kernel
def order_by_cell(cells, extent, first, last, counts, order):
    """Stable counting sort of particles [first, last) by cell, x slowest.

    Args:
        cells: lowest node of each particle, int32 [3, stride].
        extent: smallest and largest lowest node along x, y, z, int64 [6].
        first: first particle of one law.
        last: one past its last.
        counts: work space, int32, at least one element per cell of the extent plus one.
        order: result, order[i] is the particle that belongs at place i, int32 [stride].
    """
    ny = extent[3] - extent[2] + 1
    nz = extent[5] - extent[4] + 1
    cell_count = (extent[1] - extent[0] + 1) * ny * nz
    for key in range(cell_count + 1):
        counts[key] = 0
    for p in range(first, last):
        key = ((cells[0, p] - extent[0]) * ny + (cells[1, p] - extent[2])) * nz + (cells[2, p] - extent[4])
        counts[key + 1] += 1
    for key in range(cell_count):
        counts[key + 1] += counts[key]
    for p in range(first, last):
        key = ((cells[0, p] - extent[0]) * ny + (cells[1, p] - extent[2])) * nz + (cells[2, p] - extent[4])
        order[first + counts[key]] = p
        counts[key] += 1


@inner_kernel
def take_sorted(unsorted, particles, order, first, last):
    """Copy the columns of ``unsorted`` to places [first, last) of ``particles`` in a new order; as ``advance``."""
    for column in range(particles.shape[0]):
        for i in range(first, last):
            particles[column, i] = unsorted[column, order[i]]


@strict_kernel
def span_rows(cells, ranges, fields, shift, spans):
    """Find which nodes of each row of the grid the particles of each chunk may write to until the next sort.

    A particle with lowest node b writes the nodes b .. b + 2 along x and y and b .. b + 3 along z (rows of lanes), and
    may drift by one cell.

    Args:
        cells: lowest node of each particle in sorted order, world cells, int32 [3, stride].
        ranges: first and one past last particle of each law in each chunk, int64 [laws, chunks, 2].
        fields: first plane of each law's velocity field, int64 [laws].
        shift: world node of the grid's first node, int64 [3].
        spans: result, zero on entry, int32 [chunks, fields nx, ny, 2]; rounded outwards to multiples of 4, empty (0, 0)
            where nothing writes.
    """
    for chunk in range(spans.shape[0]):
        for law in range(ranges.shape[0]):
            p, last = ranges[law, chunk, 0], ranges[law, chunk, 1]
            while p < last:  # from one column of cells along z to the next: sorted particles stay together in them
                x, y, lowest = cells[0, p], cells[1, p], cells[2, p]
                highest = lowest
                while p < last and cells[0, p] == x and cells[1, p] == y:
                    if cells[2, p] < lowest:
                        lowest = cells[2, p]
                    if cells[2, p] > highest:
                        highest = cells[2, p]
                    p += 1
                low, high = (lowest - shift[2] - 1) & ~3, (highest - shift[2] + 5 + 3) & ~3
                first_plane, first_row = fields[law] + x - shift[0] - 1, y - shift[1] - 1
                for plane in range(first_plane, first_plane + 5):
                    for row in range(first_row, first_row + 5):
                        if spans[chunk, plane, row, 1] == 0 or low < spans[chunk, plane, row, 0]:
                            spans[chunk, plane, row, 0] = low
                        if high > spans[chunk, plane, row, 1]:
                            spans[chunk, plane, row, 1] = high
