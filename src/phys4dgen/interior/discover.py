"""Internal physical structure discovery: from a hollow shell of Gaussians to a body with volume, parts and an inside.

Paper: Sec. 3.3. The order here: solid voxels (carved or dense), pieces bridged, thick and thin told apart, the
paper's label grid, particles seeded, each with its part, its piece and its true volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from phys4dgen.errors import StageError
from phys4dgen.interior.bridge import BridgeReport, bridge_pieces
from phys4dgen.interior.carve import carve, solid_share
from phys4dgen.interior.density import accumulated_opacity, density_threshold
from phys4dgen.interior.labels import LabelGrid, label_cells
from phys4dgen.interior.links import link_groups
from phys4dgen.interior.measure import GaussianCloud, RodReading, covered_share, is_stout, measure_rods, measure_sheets
from phys4dgen.interior.morphology import outermost_layer
from phys4dgen.interior.seed import Seeds, join_seeds, seed_rods, seed_sheets, seed_solid
from phys4dgen.interior.sites import Sites, join_sites, ribbon_sites, rod_sites, sheet_sites
from phys4dgen.interior.thin import describe_thin_voxels, split_thick_and_thin
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import SOLID, Continuum, Frame, Gaussians, Parts, Views

__all__ = ["Interior", "discover_interior"]

_FALLBACK_THICKNESS_M = 8e-4  # a leaf blade; the part's material may know better (materials/library.yaml)
_LINK = 2.0  # voxels: particles closer than a grid cell hang together in MPM
_LONGEST_LINK = 8.0  # voxels
_COUPLED = 3.0  # voxels: particles within 1.5 cells share grid nodes
_LEAST_BODY = 0.05  # of the largest group of coupled particles
_MIN_TRUSTED_SHARE = 0.3
_SHEET_SITES = 24
_ROD_REACH = 8.0  # voxels along a rod within which its width is one
_LEAST_SHARE = 0.1  # of a voxel: no particle is without mass
_MIN_RADIUS = 3.0  # voxels: of the neighbourhood in which a sheet is measured


@dataclass(frozen=True, eq=False)
class Interior:
    """The body that was found.

    Attributes:
        continuum: the particles.
        bridges: what bridging did.
        solid_voxels: number of solid voxels.
        agreement: IoU of the carved and the dense solid, a figure of quality.
        density_threshold: that was used on the accumulated opacity.
        loose_particles: left out, because they hang in the air: their Gaussians are carried by the nearest body.
    """

    continuum: Continuum
    bridges: BridgeReport
    solid_voxels: int
    agreement: float
    density_threshold: float
    loose_particles: int


def discover_interior(
    gaussians: Gaussians,
    views: Views,
    parts: Parts,
    *,
    frame: Frame,
    cell: float,
    spacing_cells: float = 0.5,
    label_grid: int = 32,
    confidence: float = 0.95,
    max_cells_per_gaussian: int = 10,
    wall_m: Mapping[int, float] | None = None,
) -> Interior:
    """Find the solid that the Gaussians enclose and fill it with particles.

    Args:
        gaussians: the object.
        views: of the ``carve`` table.
        parts: part of each Gaussian.
        frame: input coordinates -> metres.
        cell: grid cell dx of the simulation, input units.
        spacing_cells: particle spacing in cells.
        label_grid: cells of the label grid along the longest side (the paper's 32).
        confidence: of the chi-square test for surface cells.
        max_cells_per_gaussian: of the same test.
        wall_m: wall thickness by part number where it is known: what lies deeper than the wall belongs to the part
            that fills the vessel.

    Raises:
        StageError: nothing solid was found.
    """
    rotation = frame.rotation
    side = cell * spacing_cells
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    grid = VoxelGrid.around(lower - 0.03 * (upper - lower).max(), upper + 0.03 * (upper - lower).max(), side, padding=2)
    carved = carve(grid, views, rotation)
    threshold = density_threshold(gaussians, grid, rotation)
    dense = accumulated_opacity(gaussians, grid, rotation) > threshold
    if not (carved | dense).any():
        raise StageError(
            f"Interior: no solid was found on a grid of {side:.4g} units; expected the views to show an object with"
            " opacity above 0.5. Check the input with 'phys4dgen inspect', or give a finer --simulation.grid."
        )
    agreement = float((carved & dense).sum() / max((carved | dense).sum(), 1))
    solid, bridges, bridge_report = bridge_pieces(carved | dense)

    seeds, loose = _without_crumbs(_seed(gaussians, views, solid, bridges, grid, frame))
    positions_up = grid.centers(seeds.middle + seeds.offset)
    middle_up = grid.centers(seeds.middle)

    label_side = float((upper - lower).max()) / label_grid
    cells = VoxelGrid.around(lower, upper, label_side, padding=1)
    valid = np.zeros(cells.shape, bool)
    valid[tuple(cells.index_of(grid.centers(np.argwhere(solid))).T)] = True
    labelled = label_cells(
        gaussians,
        parts.labels,
        cells,
        valid,
        rotation,
        confidence=confidence,
        max_cells_per_gaussian=max_cells_per_gaussian,
    )
    part, is_interior = _part_of_particles(gaussians, parts, middle_up, seeds.shape, labelled, side, rotation)
    unit = frame.metres_per_unit
    for number, wall in (wall_m or {}).items():
        _fill_vessel(part, is_interior, number, middle_up, gaussians, parts, rotation, wall / unit)
    positions = (positions_up @ rotation).astype(np.float32)  # what the run folder keeps, to the bit
    continuum = Continuum(
        positions=positions.astype(np.float64),
        part=part,
        is_interior=is_interior,
        volume_m3=seeds.volume * (side * unit) ** 3,
        gaussian_index=np.full(len(part), -1, np.int32),
        piece=_pieces(seeds.middle, part),
        shape=seeds.shape,
        thickness_m=seeds.thickness * side * unit,
        thickness_measured=seeds.measured,
        offset_m=seeds.offset * side * unit,
        spacing_m=side * unit,
    )
    return Interior(continuum, bridge_report, int(solid.sum()), agreement, threshold, loose)


def _seed(
    gaussians: Gaussians,
    views: Views,
    solid: NDArray[np.bool_],
    bridges: NDArray[np.bool_],
    grid: VoxelGrid,
    frame: Frame,
) -> Seeds:
    """Particles of the thick, sheet-like and rod-like regions."""
    thick, thin = split_thick_and_thin(solid)
    cloud = _cloud(gaussians, grid, frame.rotation)
    voxels = describe_thin_voxels(thin, is_stout(np.argwhere(thin).astype(np.float64), cloud))
    fallback = _FALLBACK_THICKNESS_M / (grid.side * frame.metres_per_unit)
    height = np.ptp(gaussians.robust_bounds(rotation=frame.rotation), axis=0)[2]

    sheets = sheet_sites(voxels, bridges)
    sheets, thickness, trusted = measure_sheets(sheets, cloud, radius=max(0.016 * height / grid.side, _MIN_RADIUS))
    share = covered_share(sheets, cloud)
    thickness, measured = _settle(sheets.position, thickness, trusted, fallback, sites=_SHEET_SITES)
    keep = _keep_connected(sheets, share > 0, solid=np.argwhere(thick))
    share = np.where(share > 0, share, 1 / 3)  # bridges and links stand for what the capture did not see
    thickness, measured = thickness[keep], measured[keep]
    sheets = sheets.where(keep, sheets.extent * share)

    slices, section = rod_sites(voxels, bridges)
    reading = measure_rods(slices, section, cloud)
    rods = reading.sites
    width, width_measured = _settle_width(reading)
    width = np.clip(width, 0.2, 6.0)
    flat, across = _settle_ribbons(reading)
    ribbons = ribbon_sites(rods.where(flat, rods.extent), width[flat], across[flat])
    thickness = np.concatenate([thickness, np.full(len(ribbons), fallback)])
    measured = np.concatenate([measured, np.zeros(len(ribbons), bool)])
    sheets = join_sites(sheets, ribbons)
    rods, width, width_measured = rods.where(~flat, rods.extent), np.minimum(width[~flat], 4.0), width_measured[~flat]

    body, body_share = _solid_voxels(thick, solid, views, grid, frame.rotation)
    links, link_width = link_groups(
        np.concatenate([body.astype(np.float64), sheets.position, rods.position]),
        np.concatenate([np.full(len(body), 2.0), np.ones(len(sheets)), width]),
        apart=_LINK,
        reach=_LONGEST_LINK,
    )
    rods = join_sites(rods, links)
    width = np.concatenate([width, link_width])
    width_measured = np.concatenate([width_measured, np.zeros(len(links), bool)])
    return join_seeds(
        [seed_solid(body, body_share), seed_sheets(sheets, thickness, measured), seed_rods(rods, width, width_measured)]
    )


def _solid_voxels(
    thick: NDArray[np.bool_], solid: NDArray[np.bool_], views: Views, grid: VoxelGrid, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Indices of the thick voxels, and the share of each that is solid: less than one at the body's surface."""
    index = np.argwhere(thick)
    share = np.ones(len(index))
    rim = outermost_layer(solid)[tuple(index.T)]
    share[rim] = np.clip(solid_share(grid, index[rim], views, rotation), _LEAST_SHARE, 1)
    return index, share


def _without_crumbs(seeds: Seeds) -> tuple[Seeds, int]:
    """The seeds without small groups that no grid node connects to the body, and how many were left out.

    A leaf's tip that the capture shows without its leaf would fly off on its own in the first gust.
    """
    group = _components(KDTree(seeds.middle).query_pairs(_COUPLED, output_type="ndarray"), len(seeds.middle))
    size = np.bincount(group)
    keep = (size >= _LEAST_BODY * size.max())[group]
    return Seeds(*(getattr(seeds, field.name)[keep] for field in fields(seeds))), int((~keep).sum())


def _cloud(gaussians: Gaussians, grid: VoxelGrid, rotation: NDArray[np.float64]) -> GaussianCloud:
    seen = gaussians.opacities > 0.02
    near = gaussians.subset(seen)
    means = (near.means.astype(np.float64) @ rotation.T - grid.lower) / grid.side - 0.5
    covariances = rotation @ near.covariances() @ rotation.T / grid.side**2
    return GaussianCloud(means, covariances, near.opacities.astype(np.float64))


def _settle(
    position: NDArray[np.float64],
    value: NDArray[np.float64],
    trusted: NDArray[np.bool_],
    fallback: float,
    *,
    sites: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Median of the trusted readings among the nearest ``sites``, and whether there were enough of them.

    Where too few neighbours can be trusted none is: a sparse capture's neighbourhoods cross from leaf to leaf.
    """
    if len(value) == 0:
        return value, np.zeros(0, bool)
    k = min(sites, len(value))
    _, near = KDTree(position).query(position, k=k)
    near = near.reshape(len(position), k)
    readings = np.where(trusted[near], value[near], np.nan)
    enough = trusted[near].mean(1) >= _MIN_TRUSTED_SHARE
    settled = np.full(len(value), float(fallback))
    settled[enough] = np.nanmedian(readings[enough], axis=1)
    return settled, enough


def _settle_width(reading: RodReading) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Width of each rod from the sites up and down the same rod, and whether there was one to be read.

    Where a petiole leaves its stem a slice holds both and reads too wide; a low quantile along the rod does not.
    """
    sites = reading.sites
    width = np.ones(len(sites))
    measured = reading.trusted.copy()
    if len(sites) == 0:
        return width, measured
    near = KDTree(sites.position).query_ball_point(sites.position, _ROD_REACH)
    for site, others in enumerate(near):
        others = np.array(sorted(others))
        axis = sites.direction[site]
        apart = sites.position[others] - sites.position[site]
        across = np.linalg.norm(apart - (apart @ axis)[:, None] * axis, axis=1)
        same = (across < 1.5) & (np.abs(sites.direction[others] @ axis) > 0.85) & reading.trusted[others]
        if same.any():
            width[site] = np.quantile(reading.width[others[same]], 0.3)
            measured[site] = True
    return width, measured


def _settle_ribbons(reading: RodReading) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each rod site is a ribbon, and its wide direction, by its 12 nearest trusted neighbours.

    One long blade must not change from flat to round and back with every few Gaussians.
    """
    flat, across, sites = reading.is_ribbon, reading.across, reading.sites
    known = np.flatnonzero(reading.trusted)
    if len(known) == 0:
        return flat, across
    k = min(12, len(known))
    _, near = KDTree(sites.position[known]).query(sites.position, k=k)
    near = known[near.reshape(len(sites), k)]
    flat = flat[near].mean(1) > 0.4
    weight = reading.is_ribbon[near] + 1e-3
    dyads = np.einsum("sk,ska,skb->sab", weight, across[near], across[near])
    onto = np.eye(3) - sites.direction[:, :, None] * sites.direction[:, None, :]
    return flat, np.linalg.eigh(onto @ dyads @ onto)[1][:, :, 2]


def _keep_connected(sites: Sites, seen: NDArray[np.bool_], solid: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Sites to keep: the covered ones, and groups of uncovered ones without which covered ones would come apart."""
    keep = seen.copy()
    hidden = np.flatnonzero(~seen)
    if len(hidden) == 0:
        return keep
    tree = KDTree(sites.position)
    pairs = tree.query_pairs(_LINK, output_type="ndarray")
    groups = _components(pairs[seen[pairs].all(1)], len(sites))
    hidden_groups = _components(pairs[(~seen[pairs]).all(1)], len(sites))
    mixed = pairs[seen[pairs[:, 0]] != seen[pairs[:, 1]]]
    hidden_end = np.where(seen[mixed[:, 0]], mixed[:, 1], mixed[:, 0])
    seen_end = np.where(seen[mixed[:, 0]], mixed[:, 0], mixed[:, 1])
    touches = np.unique(np.stack([hidden_groups[hidden_end], groups[seen_end]], 1), axis=0)
    if len(solid):
        distance, _ = KDTree(solid).query(sites.position[hidden], distance_upper_bound=_LINK)
        at_solid = np.unique(hidden_groups[hidden[np.isfinite(distance)]])
        touches = np.concatenate([touches, np.stack([at_solid, np.full(len(at_solid), -1)], 1)])
    group, neighbors = np.unique(touches[:, 0], return_counts=True)
    needed = group[neighbors >= 2]
    keep[hidden] = np.isin(hidden_groups[hidden], needed) | sites.is_bridge[hidden]
    return keep


def _components(pairs: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    graph = sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def _part_of_particles(
    gaussians: Gaussians,
    parts: Parts,
    points_up: NDArray[np.float64],
    shape: NDArray[np.int8],
    labelled: LabelGrid,
    side: float,
    rotation: NDArray[np.float64],
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Part of each particle: the Gaussians around it where there are any, else its label cell's.

    The cells of the label grid are as wide as a leaf stands from its stem; Gaussians within 1.5 particle spacings
    say more than the cell does.
    """
    seen = gaussians.opacities > 0.1 if (gaussians.opacities > 0.1).any() else gaussians.opacities > 0
    means = gaussians.means[seen].astype(np.float64) @ rotation.T
    k = min(8, len(means))
    distance, near = KDTree(means).query(points_up, k=k, workers=-1)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    weight = np.exp(-0.5 * (distance / (0.5 * side)) ** 2) * gaussians.opacities[seen][near] + 1e-12 / (1 + distance)
    votes = np.zeros((len(points_up), parts.count))
    for j in range(k):
        votes[np.arange(len(points_up)), parts.labels[seen][near[:, j]]] += weight[:, j]
    part = votes.argmax(1).astype(np.int32)
    cell = tuple(labelled.grid.index_of(points_up).T)
    cell_part = labelled.part[cell]
    deep = (distance[:, 0] > 1.5 * side) & (shape == SOLID) & (cell_part >= 0)
    part[deep] = cell_part[deep]
    is_interior = labelled.is_interior[cell] & deep
    return part, is_interior


def _fill_vessel(
    part: NDArray[np.int32],
    is_interior: NDArray[np.bool_],
    vessel: int,
    points_up: NDArray[np.float64],
    gaussians: Gaussians,
    parts: Parts,
    rotation: NDArray[np.float64],
    wall: float,
) -> None:
    """Give what lies deeper than the wall of a vessel to the part that is seen on top of it (in place).

    No picture shows where pot ends and soil begins; a known wall thickness does.
    """
    mine = parts.labels == vessel
    means = gaussians.means.astype(np.float64) @ rotation.T
    members = np.flatnonzero(part == vessel)
    if len(members) == 0 or mine.all():
        return
    distance, _ = KDTree(means[mine]).query(points_up[members], workers=-1)
    deep = members[distance > wall]
    if len(deep) == 0:
        return
    # The filling is what is seen first when one looks up from inside: the lowest other Gaussian of each column.
    others = np.flatnonzero(~mine & (gaussians.opacities > 0.3))
    distance, above = KDTree(means[others][:, :2]).query(points_up[deep][:, :2], k=min(32, len(others)), workers=-1)
    above = others[above.reshape(len(deep), -1)]
    height = np.where(distance.reshape(above.shape) < wall, means[above, 2], np.inf)
    lowest = above[np.arange(len(deep)), height.argmin(1)][np.isfinite(height.min(1))]
    if len(lowest) == 0:
        return
    filling = np.bincount(parts.labels[lowest], minlength=parts.count).argmax()
    part[deep] = filling
    is_interior[deep] = True


def _pieces(middle: NDArray[np.float64], part: NDArray[np.int32]) -> NDArray[np.int32]:
    """Connected piece of each particle within its part."""
    pairs = KDTree(middle).query_pairs(_LINK, output_type="ndarray")
    same = part[pairs[:, 0]] == part[pairs[:, 1]]
    return _components(pairs[same], len(middle)).astype(np.int32)
