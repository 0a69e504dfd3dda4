"""From solid voxels to particles: thick bodies on the lattice, sheets on two faces, rods in strands, nothing loose."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from phys4dgen.interior.carve import InsideTest, solid_share
from phys4dgen.interior.groups import body_surface, particle_groups
from phys4dgen.interior.links import link_groups
from phys4dgen.interior.measure import GaussianCloud, covered_share, is_stout, measure_rods, measure_sheets
from phys4dgen.interior.morphology import outermost_layer
from phys4dgen.interior.seed import Seeds, join_seeds, seed_rods, seed_sheets, seed_solid
from phys4dgen.interior.settle import keep_connected, settle_ribbons, settle_thickness, settle_width
from phys4dgen.interior.sites import join_sites, ribbon_sites, rod_sites, sheet_sites
from phys4dgen.interior.thin import describe_thin_voxels, split_thick_and_thin
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import SOLID, Frame, Gaussians

__all__ = ["LINK", "populate"]

LINK = 2.0
"""Voxels: particles closer than a grid cell hang together in MPM."""

_FALLBACK_THICKNESS_M = 8e-4  # a leaf blade; the part's material may know better (materials/library.yaml)
_LONGEST_LINK = 8.0  # voxels
_COUPLED = 3.0  # voxels: particles within 1.5 cells share grid nodes
_LEAST_BODY = 0.05  # of the largest group of coupled particles
_SHEET_SITES = 24
_SURFACE_LAYERS = 2  # carving reaches at most half a voxel beyond the surface, and its dilation a quarter
_LEAST_SHARE = 0.05  # of a voxel: no particle is without mass
_MIN_RADIUS = 3.0  # voxels: of the neighbourhood in which a sheet is measured


def populate(
    gaussians: Gaussians,
    solid: NDArray[np.bool_],
    bridges: NDArray[np.bool_],
    *,
    grid: VoxelGrid,
    inside: InsideTest,
    frame: Frame,
    spacing_cells: float,
    skin_only: bool = False,
) -> tuple[Seeds, int]:
    """Particles of the thick, sheet-like and rod-like regions.

    Args:
        gaussians: the object.
        solid: solid voxels, ``grid.shape``.
        bridges: those of them that stand for gaps of the capture.
        grid: voxels in upright axes.
        inside: whether points lie inside the object, sharp.
        frame: input coordinates -> metres.
        spacing_cells: a voxel in grid cells.
        skin_only: thick bodies are their outermost layer of voxels.

    Returns:
        The particles, and how many were left out because they hang in the air.
    """
    thick, thin = split_thick_and_thin(solid)
    cloud = _cloud(gaussians, grid, frame.rotation)
    voxels = describe_thin_voxels(thin, is_stout(np.argwhere(thin).astype(np.float64), cloud))
    fallback = _FALLBACK_THICKNESS_M / (grid.side * frame.metres_per_unit)
    height = np.ptp(gaussians.robust_bounds(rotation=frame.rotation), axis=0)[2]

    sheets = sheet_sites(voxels, bridges)
    sheets, thickness, trusted = measure_sheets(sheets, cloud, radius=max(0.016 * height / grid.side, _MIN_RADIUS))
    share = covered_share(sheets, cloud)
    thickness, measured = settle_thickness(sheets.position, thickness, trusted, fallback, sites=_SHEET_SITES)
    keep = keep_connected(sheets, share > 0, solid=np.argwhere(thick), link=LINK)
    share = np.where(share > 0, share, 1 / 3)  # bridges and links stand for what the capture did not see
    thickness, measured = thickness[keep], measured[keep]
    sheets = sheets.where(keep, sheets.extent * share)

    slices, section = rod_sites(voxels, bridges)
    reading = measure_rods(slices, section, cloud)
    rods = reading.sites
    width, width_measured = settle_width(reading)
    width = np.clip(width, 0.2, 6.0)
    flat, across = settle_ribbons(reading)
    ribbons = ribbon_sites(rods.where(flat, rods.extent), width[flat], across[flat])
    thickness = np.concatenate([thickness, np.full(len(ribbons), fallback)])
    measured = np.concatenate([measured, np.zeros(len(ribbons), bool)])
    sheets = join_sites(sheets, ribbons)
    rods, width, width_measured = rods.where(~flat, rods.extent), np.minimum(width[~flat], 4.0), width_measured[~flat]

    kept = thick & outermost_layer(solid) if skin_only else thick
    body, body_share = _solid_voxels(kept, solid, inside, grid, frame.rotation)
    outer, body_number = body_surface(body)
    others = len(sheets) + len(rods)
    links, link_width = link_groups(
        np.concatenate([body[outer].astype(np.float64), sheets.position, rods.position]),
        np.concatenate([np.full(int(outer.sum()), 2.0), np.ones(len(sheets)), width]),
        np.concatenate([body_number[outer], np.full(others, -1, np.int32)]),
        apart=LINK,
        reach=_LONGEST_LINK,
    )
    rods = join_sites(rods, links)
    width = np.concatenate([width, link_width])
    width_measured = np.concatenate([width_measured, np.zeros(len(links), bool)])
    return _without_crumbs(
        join_seeds(
            [
                seed_solid(body, body_share),
                seed_sheets(sheets, thickness, measured, spacing_cells=spacing_cells),
                seed_rods(rods, width, width_measured),
            ]
        )
    )


def _solid_voxels(
    thick: NDArray[np.bool_],
    solid: NDArray[np.bool_],
    inside: InsideTest,
    grid: VoxelGrid,
    rotation: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Indices of the thick voxels, and the share of each that is solid: less than one at the body's surface."""
    index = np.argwhere(thick)
    share = np.ones(len(index))
    rim = outermost_layer(solid, layers=_SURFACE_LAYERS)[tuple(index.T)]
    share[rim] = np.clip(solid_share(grid, index[rim], inside, rotation), _LEAST_SHARE, 1)
    return index, share


def _without_crumbs(seeds: Seeds) -> tuple[Seeds, int]:
    """The seeds without small groups that no grid node connects to the body, and how many were left out.

    A leaf's tip that the capture shows without its leaf would fly off on its own in the first gust.
    """
    group = particle_groups(seeds.middle, seeds.shape == SOLID, _COUPLED)
    size = np.bincount(group)
    keep = (size >= _LEAST_BODY * size.max())[group]
    return Seeds(*(getattr(seeds, field.name)[keep] for field in fields(seeds))), int((~keep).sum())


def _cloud(gaussians: Gaussians, grid: VoxelGrid, rotation: NDArray[np.float64]) -> GaussianCloud:
    seen = gaussians.opacities > 0.02
    near = gaussians.subset(seen)
    means = (near.means.astype(np.float64) @ rotation.T - grid.lower) / grid.side - 0.5
    covariances = rotation @ near.covariances() @ rotation.T / grid.side**2
    return GaussianCloud(means, covariances, near.opacities.astype(np.float64))
