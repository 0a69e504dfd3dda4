"""Internal physical structure discovery: from a hollow shell of Gaussians to a body with volume, parts and an inside.

Paper: Sec. 3.3. The order here: solid voxels (carved or dense), pieces bridged, thick and thin told apart, the
paper's label grid, particles seeded, each with its part, its piece and its true volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.interior.bridge import BridgeReport, bridge_pieces
from phys4dgen.interior.carve import InsideTest
from phys4dgen.interior.gaussian_particles import gaussians_as_particles
from phys4dgen.interior.groups import particle_groups
from phys4dgen.interior.hollow import hollowed
from phys4dgen.interior.labels import label_cells
from phys4dgen.interior.normals import seen_from
from phys4dgen.interior.ownership import fill_vessel, part_of_particles
from phys4dgen.interior.populate import LINK, populate
from phys4dgen.interior.solid import Method, find_solid, known_solid
from phys4dgen.interior.thickness import with_thickness
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
        agreement: IoU of the carved and the dense solid, of the carved and the wound one where that was asked for: a
            figure of quality; NaN where the inside was known.
        density_threshold: that was used on the accumulated opacity; NaN where the inside was known.
        loose_particles: left out, because they hang in the air: their Gaussians are carried by the nearest body.
        backend: what told the inside, for the report.
    """

    continuum: Continuum
    bridges: BridgeReport
    solid_voxels: int
    agreement: float
    density_threshold: float
    loose_particles: int
    backend: str


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
    method: Method = "ipsd",
    hollow_m: Mapping[int, float] | None = None,
    gaussian_particles: bool = False,
    known: InsideTest | None = None,
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
        method: ``ipsd`` carves by masks and depths (the paper's), ``winding`` fills by the winding number, ``both``
            what the two agree on; ``none`` leaves bodies a skin of one layer (the paper's ablation).
        hollow_m: wall thickness by part number of parts that are hollow: what lies deeper is left empty.
        gaussian_particles: the Gaussians themselves are the particles, as in the paper.
        known: the exact inside, where the maker of the object knows it; it stands for ``method``, and every Gaussian is
            taken to lie in the surface.

    Raises:
        StageError: nothing solid was found.
    """
    rotation = frame.rotation
    side = cell * spacing_cells
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    grid = VoxelGrid.around(lower - 0.03 * (upper - lower).max(), upper + 0.03 * (upper - lower).max(), side, padding=2)
    if known is None:
        reading = find_solid(gaussians, views, grid=grid, rotation=rotation, method=method)
    else:
        reading = known_solid(gaussians, known, grid=grid, rotation=rotation)
    if not reading.solid.any():
        raise StageError(
            f"Interior: no solid was found on a grid of {side:.4g} units; expected the views to show an object with"
            " opacity above 0.5. Check the input with 'phys4dgen inspect', or give a finer --simulation.grid."
        )
    solid, bridges, bridge_report = bridge_pieces(reading.solid)

    surface, labels = gaussians, parts.labels
    if known is None:
        surface, labels = _surface(gaussians, parts, views, tolerance=side)
    cells = VoxelGrid.around(lower, upper, float((upper - lower).max()) / label_grid, padding=1)
    valid = np.zeros(cells.shape, bool)
    valid[tuple(cells.index_of(grid.centers(np.argwhere(solid))).T)] = True
    labelled = label_cells(
        surface, labels, cells, valid, rotation, confidence=confidence, max_cells_per_gaussian=max_cells_per_gaussian
    )
    unit = frame.metres_per_unit
    walls = {number: wall / unit for number, wall in (hollow_m or {}).items()}
    if walls:
        solid = hollowed(solid, walls, gaussians=surface, grid=grid, labelled=labelled, rotation=rotation)
    seeds, loose = populate(
        gaussians,
        solid,
        bridges & solid,
        grid=grid,
        inside=reading.inside,
        frame=frame,
        spacing_cells=spacing_cells,
        skin_only=method == "none",
    )
    positions_up = grid.centers(seeds.middle + seeds.offset)
    middle_up = grid.centers(seeds.middle)
    part, is_interior = part_of_particles(surface, labels, middle_up, seeds.shape, labelled, side, rotation)
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
        site=seeds.site,
        spacing_m=side * unit,
    )
    if hollow_m:  # the Gaussians show the outer face of a wall alone: its thickness was not to be read there
        thin_wall = np.isin(part, list(hollow_m)) & (seeds.shape != SOLID)
        continuum = with_thickness(continuum, frame=frame, given_m=hollow_m, library_m={})
        continuum = replace(continuum, thickness_measured=continuum.thickness_measured | thin_wall)
    if gaussian_particles:
        continuum = gaussians_as_particles(
            gaussians, parts.labels, continuum, labelled=labelled, frame=frame, cell=cell
        )
    return Interior(
        continuum,
        bridge_report,
        int(solid.sum()),
        reading.agreement,
        reading.density_threshold,
        loose,
        reading.backend,
    )


def _surface(
    gaussians: Gaussians, parts: Parts, views: Views, *, tolerance: float
) -> tuple[Gaussians, NDArray[np.int32]]:
    """The Gaussians that some view sees, with their labels: buried ones are no surface, whatever they belong to.

    Parts that no view sees keep all of theirs.
    """
    seen, _ = seen_from(gaussians.means.astype(np.float64), views, tolerance=tolerance)
    hidden_part = np.bincount(parts.labels[seen], minlength=parts.count) == 0
    seen |= hidden_part[parts.labels]
    return gaussians.subset(seen), parts.labels[seen]


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
