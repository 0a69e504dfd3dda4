"""Sites on the mid-surface of sheets and on the centre line of rods, with their area or length.

Sheets are sampled as height fields over the axis that their normal is nearest to: one site per voxel column, which
stands for the area h^2 / |n_d| of the sheet. Rods are sampled slice by slice along the axis nearest to their own.
The voxels are wider than the thing; what counts is where the Gaussians cover the mid-surface.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from phys4dgen.interior.thin import ThinVoxels, neighbor_graph
from phys4dgen.types import ROD, SHEET

__all__ = ["Sites", "join_sites", "ribbon_sites", "rod_sites", "sheet_sites"]


@dataclass(frozen=True, eq=False)
class Sites:
    """S sites in upright axes; lengths in voxels.

    Attributes:
        position: on the mid-surface or centre line, [S, 3].
        direction: unit normal of the sheet, to one side where its columns run along the same axis, or unit axis of the
            rod, [S, 3].
        extent: area of the sheet (voxels squared) or length of the rod (voxels) that the site stands for, [S].
        edge_a: one step of the site's cell along the sheet, [S, 3] (zero for rods).
        edge_b: the other step, [S, 3] (zero for rods).
        is_bridge: the site lies on a bridge over a gap of the capture, [S].
        is_odd: by turns along the sheet as the colours of a chequerboard, or along the rod, [S].
    """

    position: NDArray[np.float64]
    direction: NDArray[np.float64]
    extent: NDArray[np.float64]
    edge_a: NDArray[np.float64]
    edge_b: NDArray[np.float64]
    is_bridge: NDArray[np.bool_]
    is_odd: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.position)

    def where(self, keep: NDArray[np.bool_], extent: NDArray[np.float64]) -> Sites:
        """The chosen sites, with another extent."""
        return replace(Sites(*(getattr(self, field.name)[keep] for field in fields(self))), extent=extent[keep])


def sheet_sites(thin: ThinVoxels, bridges: NDArray[np.bool_]) -> Sites:
    """One site per voxel column of each sheet."""
    own = thin.kind == SHEET
    index, normal, middle = thin.index[own], thin.direction[own], thin.middle[own]
    if len(index) == 0:
        return _no_sites()
    axis = _majority_axis(index, normal, bridges.shape)
    b_axis, c_axis = (axis + 1) % 3, (axis + 2) % 3
    rows = np.arange(len(index))
    along = index[rows, axis]
    columns = np.stack([axis, index[rows, b_axis], index[rows, c_axis], along], 1)
    order = np.lexsort(columns.T[::-1])
    columns = columns[order]
    new_run = np.ones(len(order), bool)
    new_run[1:] = (columns[1:, :3] != columns[:-1, :3]).any(1) | (columns[1:, 3] > columns[:-1, 3] + 1)
    run = np.cumsum(new_run) - 1
    runs = int(run[-1]) + 1

    # Height of the local plane over the column's own centre, averaged over the column's voxels.
    n, m, cell = normal[order], middle[order], index[order].astype(np.float64)
    a = columns[:, 0].astype(int)
    r = np.arange(len(order))
    n_axis = n[r, a]
    n_axis = np.where(np.abs(n_axis) < 0.3, np.copysign(0.3, n_axis), n_axis)
    rise = ((m - cell) * n).sum(1) / n_axis
    height = cell[r, a] + np.clip(rise, -2, 2)
    count = np.bincount(run)
    first = np.flatnonzero(new_run)
    position = cell[first]
    position[np.arange(runs), a[first]] = np.bincount(run, height) / count
    dyads = np.stack([np.bincount(run, n[:, i] * n[:, j]) for i in range(3) for j in range(3)], 1)
    direction = np.linalg.eigh(dyads.reshape(-1, 3, 3))[1][:, :, 2]

    a = a[first]
    rows = np.arange(runs)
    direction *= np.where(direction[rows, a] < 0, -1, 1)[:, None]
    n_axis = direction[rows, a]
    edges = []
    for shift in (1, 2):
        step = np.zeros((runs, 3))
        other = (a + shift) % 3
        step[rows, other] = 1
        step[rows, a] = -direction[rows, other] / np.where(np.abs(n_axis) < 0.3, np.copysign(0.3, n_axis), n_axis)
        edges.append(step)
    area = np.linalg.norm(np.cross(edges[0], edges[1]), axis=1)
    area = np.minimum(area, 1 / _local_density(position, direction))
    on_bridge = np.bincount(run, bridges[tuple(index[order].T)]) > 0.5 * count
    is_odd = columns[first, 1:3].sum(1) % 2 > 0
    return Sites(position, direction, area, edges[0], edges[1], on_bridge, is_odd)


def rod_sites(thin: ThinVoxels, bridges: NDArray[np.bool_]) -> tuple[Sites, NDArray[np.float64]]:
    """One site per slice of each rod, and the area of its voxels' cross-section (voxels squared)."""
    own = thin.kind == ROD
    index, axis_vector, middle = thin.index[own], thin.direction[own], thin.middle[own]
    if len(index) == 0:
        return _no_sites(), np.zeros(0)
    axis = _majority_axis(index, axis_vector, bridges.shape)
    graph = neighbor_graph(index, bridges.shape).tocoo()
    same = (axis[graph.row] == axis[graph.col]) & (
        index[graph.row, axis[graph.row]] == index[graph.col, axis[graph.row]]
    )
    slices = sparse.csr_matrix(
        (np.ones(int(same.sum())), (graph.row[same], graph.col[same])), shape=(len(index), len(index))
    )
    count, group = connected_components(slices, directed=False)
    size = np.bincount(group)
    # Voxels slide along the axis onto the local centre line before they are averaged.
    offset = middle - index
    onto = index + offset - axis_vector * (offset * axis_vector).sum(1, keepdims=True)
    position = np.stack([np.bincount(group, onto[:, k]) for k in range(3)], 1) / size[:, None]
    dyads = np.stack([np.bincount(group, axis_vector[:, i] * axis_vector[:, j]) for i in range(3) for j in range(3)], 1)
    direction = np.linalg.eigh(dyads.reshape(-1, 3, 3))[1][:, :, 2]
    main, slice_number = np.zeros(count, int), np.zeros(count, int)
    main[group] = axis
    slice_number[group] = index[np.arange(len(index)), axis]
    length = 1 / np.maximum(np.abs(direction[np.arange(count), main]), 0.5)
    zero = np.zeros((count, 3))
    on_bridge = np.bincount(group, bridges[tuple(index.T)]) > 0.5 * size
    return Sites(position, direction, length, zero, zero, on_bridge, slice_number % 2 > 0), size / length


def ribbon_sites(rods: Sites, width: NDArray[np.float64], across: NDArray[np.float64]) -> Sites:
    """Flat rods as sheets: two sheet sites per slice, at +- width / (2 sqrt 3), which keep the second moment."""
    shift = (width / (2 * np.sqrt(3)))[:, None] * across
    normal = np.cross(rods.direction, across)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    halves = rods.where(np.ones(len(rods), bool), rods.extent * width / 2)
    left = replace(halves, position=rods.position + shift, direction=normal)
    right = replace(halves, position=rods.position - shift, direction=normal, is_odd=~rods.is_odd)
    return join_sites(left, right)


def join_sites(first: Sites, second: Sites) -> Sites:
    """Both groups of sites, in order."""
    return Sites(*(np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields(Sites)))


def _majority_axis(
    index: NDArray[np.int64], direction: NDArray[np.float64], shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """The coordinate axis nearest to the direction, smoothed over neighbours so that regions do not fray."""
    axis = np.abs(direction).argmax(1)
    graph = neighbor_graph(index, shape)
    graph = graph @ graph
    for _ in range(2):
        votes = np.stack([np.asarray(graph @ (axis == k).astype(np.float64)) for k in range(3)], 1)
        # An axis that the direction hardly has may not win: its columns would be stretched without bound.
        votes[np.abs(direction) < 0.4] = -1
        axis = votes.argmax(1)
    return axis


def _local_density(position: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sites per unit area around each site; more than one where two column directions overlap."""
    tree = KDTree(position)
    pairs = tree.query_pairs(3.0, output_type="ndarray")
    apart = position[pairs[:, 1]] - position[pairs[:, 0]]
    density = np.full(len(position), 1.0)
    for here, there in ((0, 1), (1, 0)):
        normal = direction[pairs[:, here]]
        off = (apart * normal).sum(1)
        same_sheet = (np.abs(off) < 1.0) & (np.abs((normal * direction[pairs[:, there]]).sum(1)) > 0.6)
        distance2 = (apart * apart).sum(1) - off * off
        weight = np.where(same_sheet, np.exp(-0.5 * distance2), 0)
        density += np.bincount(pairs[:, here], weight, len(position))
    return density / (2 * np.pi)


def _no_sites() -> Sites:
    zero = np.zeros((0, 3))
    return Sites(zero, zero, np.zeros(0), zero, zero, np.zeros(0, bool), np.zeros(0, bool))
