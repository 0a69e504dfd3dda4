"""Internal physical structure discovery: from a hollow shell of Gaussians to a body with volume, parts and an inside.

Paper: Sec. 3.3. The order here: solid voxels (carved or dense), pieces bridged, thick and thin told apart, the
paper's label grid, particles seeded, each with its part, its piece and its true volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.interior.bridge import BridgeReport, bridge_pieces
from phys4dgen.interior.carve import DepthLimits, carve
from phys4dgen.interior.density import accumulated_opacity, density_threshold
from phys4dgen.interior.groups import particle_groups
from phys4dgen.interior.labels import label_cells
from phys4dgen.interior.ownership import fill_vessel, part_of_particles
from phys4dgen.interior.populate import LINK, populate
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import SOLID, Continuum, Frame, Gaussians, Parts, Views

__all__ = ["Interior", "discover_interior"]


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
    carved = carve(grid, DepthLimits(views, dilate=True), rotation)
    threshold = density_threshold(gaussians, grid, rotation)
    dense = accumulated_opacity(gaussians, grid, rotation) > threshold
    if not (carved | dense).any():
        raise StageError(
            f"Interior: no solid was found on a grid of {side:.4g} units; expected the views to show an object with"
            " opacity above 0.5. Check the input with 'phys4dgen inspect', or give a finer --simulation.grid."
        )
    agreement = float((carved & dense).sum() / max((carved | dense).sum(), 1))
    solid, bridges, bridge_report = bridge_pieces(carved | dense)

    seeds, loose = populate(gaussians, solid, bridges, grid=grid, surface=DepthLimits(views, dilate=False), frame=frame)
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
    part, is_interior = part_of_particles(gaussians, parts, middle_up, seeds.shape, labelled, side, rotation)
    unit = frame.metres_per_unit
    for number, wall in (wall_m or {}).items():
        fill_vessel(part, is_interior, number, middle_up, gaussians, views, parts, rotation, wall / unit)
    positions = (positions_up @ rotation).astype(np.float32)  # what the run folder keeps, to the bit
    continuum = Continuum(
        positions=positions.astype(np.float64),
        part=part,
        is_interior=is_interior,
        volume_m3=seeds.volume * (side * unit) ** 3,
        gaussian_index=np.full(len(part), -1, np.int32),
        piece=_pieces(seeds.middle, seeds.shape == SOLID, part),
        shape=seeds.shape,
        thickness_m=seeds.thickness * side * unit,
        thickness_measured=seeds.measured,
        offset_m=seeds.offset * side * unit,
        spacing_m=side * unit,
    )
    return Interior(continuum, bridge_report, int(solid.sum()), agreement, threshold, loose)


def _pieces(middle: NDArray[np.float64], is_voxel: NDArray[np.bool_], part: NDArray[np.int32]) -> NDArray[np.int32]:
    """Connected piece of each particle within its part."""
    piece = np.zeros(len(part), np.int32)
    count = 0
    for number in np.unique(part):
        own = part == number
        group = particle_groups(middle[own], is_voxel[own], LINK)
        piece[own] = group + count
        count += int(group.max()) + 1
    return piece
