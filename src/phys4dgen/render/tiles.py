"""Depth order and tile lists: one stable radix sort of all Gaussians, then a stable counting sort into tiles.

Sorting once by depth and distributing in that order gives every tile its list front to back without a sort per tile.
Both sorts are stable, so equal depths keep the order of the Gaussians whatever the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from phys4dgen.render.projection import CULLED

__all__ = ["count_tile_pairs", "fill_tile_lists", "prefix_tile_counts", "sort_by_depth"]

_BITS = 11
_BINS = 1 << _BITS


@njit(cache=True, nogil=True)
def sort_by_depth(sort_keys, order, keys_scratch, order_scratch):
    """Order the Gaussians that are not culled by key; least-significant-digit radix sort, 3 x 11 bits.

    Args:
        sort_keys: [N] uint32; destroyed.
        order: out, [N] int32: indices in ascending key order, the first ``return value`` entries are valid.
        keys_scratch: [N] uint32.
        order_scratch: [N] int32.

    Returns:
        Number of Gaussians not culled.
    """
    histogram = np.zeros((3, _BINS), np.int64)
    mask = np.uint32(_BINS - 1)
    count = 0
    for i in range(sort_keys.shape[0]):
        key = sort_keys[i]
        if key != CULLED:
            sort_keys[count] = key
            order_scratch[count] = i
            count += 1
            histogram[0, key & mask] += 1
            histogram[1, (key >> np.uint32(_BITS)) & mask] += 1
            histogram[2, key >> np.uint32(2 * _BITS)] += 1
    keys_in, order_in, keys_out, order_out = sort_keys, order_scratch, keys_scratch, order
    for digit in range(3):
        total = 0
        for b in range(_BINS):
            in_bin = histogram[digit, b]
            histogram[digit, b] = total
            total += in_bin
        shift = np.uint32(_BITS * digit)
        for i in range(count):
            key = keys_in[i]
            b = (key >> shift) & mask
            slot = histogram[digit, b]
            histogram[digit, b] = slot + 1
            keys_out[slot] = key
            order_out[slot] = order_in[i]
        keys_in, keys_out = keys_out, keys_in
        order_in, order_out = order_out, order_in
    return count  # three passes: the result lies in ``order``


@njit(cache=True, nogil=True)
def count_tile_pairs(part, parts, order, count, tile_rects, sorted_rects, tile_columns, tile_counts):
    """Count, for slice ``part`` of the depth order, how many Gaussians touch each tile.

    Args:
        part: slice of the depth order.
        parts: number of slices.
        order: [N] int32.
        count: number of valid entries of ``order``.
        tile_rects: [N, 4] int16, in the order of the Gaussians.
        sorted_rects: out, [N, 4] int16: the same in depth order.
        tile_columns: tiles per row.
        tile_counts: out, [parts, tiles] int64.
    """
    counts = tile_counts[part]
    counts[:] = 0
    for i in range(count * part // parts, count * (part + 1) // parts):
        source = order[i]
        column_first, column_last = tile_rects[source, 0], tile_rects[source, 1]
        row_first, row_last = tile_rects[source, 2], tile_rects[source, 3]
        sorted_rects[i, 0], sorted_rects[i, 1] = column_first, column_last
        sorted_rects[i, 2], sorted_rects[i, 3] = row_first, row_last
        for row in range(row_first, row_last + 1):
            first = row * tile_columns + column_first
            for tile in range(first, first + column_last - column_first + 1):
                counts[np.uint64(tile)] += 1


@njit(cache=True, nogil=True)
def prefix_tile_counts(tile_counts, tile_starts):
    """Turn counts into write positions: tile by tile and within a tile slice by slice.

    Args:
        tile_counts: [parts, tiles] int64; becomes the first position of each slice in each tile.
        tile_starts: out, [tiles + 1] int64.
    """
    parts, tiles = tile_counts.shape
    position = 0
    for tile in range(tiles):
        tile_starts[tile] = position
        for part in range(parts):
            in_tile = tile_counts[part, tile]
            tile_counts[part, tile] = position
            position += in_tile
    tile_starts[tiles] = position


@njit(cache=True, nogil=True)
def fill_tile_lists(
    part, parts, order, count, sorted_rects, tile_columns, band_first, band_last, base, positions, tile_lists
):
    """Write the indices of the Gaussians of slice ``part`` into the lists of the tile rows of one band.

    Args:
        part: slice of the depth order, as in ``count_tile_pairs``.
        parts: number of slices.
        order: [N] int32.
        count: number of valid entries of ``order``.
        sorted_rects: [N, 4] int16, depth order.
        tile_columns: tiles per row.
        band_first: first tile row of the band.
        band_last: last tile row of the band, inclusive.
        base: position that is slot 0 of ``tile_lists``.
        positions: [parts, tiles] int64 of ``prefix_tile_counts``; advanced.
        tile_lists: out, [pairs of the band] int32.
    """
    slots = positions[part]
    for i in range(count * part // parts, count * (part + 1) // parts):
        row_first, row_last = max(sorted_rects[i, 2], band_first), min(sorted_rects[i, 3], band_last)
        columns = sorted_rects[i, 1] - sorted_rects[i, 0] + 1
        source = order[i]
        for row in range(row_first, row_last + 1):
            first = row * tile_columns + sorted_rects[i, 0]
            for tile in range(first, first + columns):
                slot = slots[np.uint64(tile)]
                tile_lists[np.uint64(slot - base)] = source
                slots[np.uint64(tile)] = slot + 1
