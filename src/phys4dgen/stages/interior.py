"""The inside: particles that fill the solid and lie in the sheets (Paper: Sec. 3.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.interior import Interior, as_lumps, discover_interior, joined_interiors, with_thickness
from phys4dgen.materials.library import find_entry
from phys4dgen.progress import Progress
from phys4dgen.scene import PartOptions, Scene, options_by_part
from phys4dgen.stages.apart import parts_apart
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.views import rendered
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["fill", "settled_thickness"]

_SAME_PLACE = 0.75
"""Particles of two bodies that are nearer than this, in particle spacings, claim one place."""


def fill(scene: Scene, asset: Asset, parts: Parts, progress: Progress) -> Interior:
    """Find the inside and fill it with particles (Paper: Sec. 3.3); separate parts are looked at by themselves."""
    bodies = list(parts_apart(scene, parts).values())
    hollow = _hollow_walls(scene, parts)
    if len(bodies) == 1:
        return _filled(scene, asset, parts, hollow, progress)
    found = []
    for numbers in bodies:
        rows = np.flatnonzero(np.isin(parts.labels, numbers))
        gaussians = asset.gaussians.subset(rows)
        lower, upper = gaussians.robust_bounds(rotation=asset.frame.rotation)
        labels = np.searchsorted(numbers, parts.labels[rows]).astype(np.int32)
        own = Parts(labels, tuple(parts.names[number] for number in numbers), parts.backend)
        walls = {k: hollow[number] for k, number in enumerate(numbers.tolist()) if number in hollow}
        progress.note(f"By itself: {', '.join(own.names)}.")
        # The exact inside is of all parts together; alone, each is found as a capture's is.
        alone = replace(asset, gaussians=gaussians, lower=lower, upper=upper, solid=None)
        interior = _filled(scene, alone, own, walls, progress)
        itself = interior.continuum.gaussian_index
        continuum = replace(
            interior.continuum,
            part=numbers[interior.continuum.part].astype(np.int32),
            gaussian_index=np.where(itself < 0, -1, rows[itself]).astype(np.int32),
        )
        found.append(replace(interior, continuum=continuum))
    return joined_interiors(_without_overlaps(found, asset, parts))


def _without_overlaps(found: list[Interior], asset: Asset, parts: Parts) -> list[Interior]:
    """Where two bodies claim one place (of a face that nobody saw), the one whose Gaussians are nearer has it."""
    means = asset.gaussians.means.astype(np.float64)
    body_of = np.zeros(parts.count, np.intp)
    for body, interior in enumerate(found):
        body_of[np.unique(interior.continuum.part)] = body
    surface = KDTree(means)
    trees = [KDTree(interior.continuum.positions) for interior in found]
    kept = []
    for body, interior in enumerate(found):
        points = interior.continuum.positions
        reach = _SAME_PLACE * interior.continuum.spacing_m / asset.frame.metres_per_unit
        claimed = np.zeros(len(points), np.bool_)
        for other, tree in enumerate(trees):
            if other != body:
                claimed |= np.isfinite(tree.query(points, distance_upper_bound=reach)[0])
        _, nearest = surface.query(points[claimed])
        claimed[claimed] = body_of[parts.labels[nearest]] != body
        kept.append(replace(interior, continuum=interior.continuum.subset(~claimed)))
    return kept


def _filled(scene: Scene, asset: Asset, parts: Parts, hollow: dict[int, float], progress: Progress) -> Interior:
    """The inside of parts that hang together."""
    wanted = scene.interior
    spacing = 0.5 if isinstance(wanted.spacing, str) else wanted.spacing
    known = asset.solid.contains if asset.solid is not None and wanted.method == "auto" else None
    views = rendered(asset, "carve", 640, progress) if known is None else rendered(asset, "object", 256, progress)
    walls = {number: wall for number, wall in _given_thickness(scene, parts).items() if number not in hollow}
    interior = discover_interior(
        asset.gaussians,
        views,
        parts,
        frame=asset.frame,
        cell=asset.cell,
        spacing_cells=spacing,
        label_grid=wanted.label_grid,
        confidence=wanted.confidence,
        max_cells_per_gaussian=wanted.max_particles_per_gaussian,
        wall_m=walls,
        method="ipsd" if wanted.method == "auto" else wanted.method,
        hollow_m=hollow,
        gaussian_particles=wanted.particles == "gaussians",
        known=known,
    )
    found = interior.bridges
    progress.note(
        f"{len(interior.continuum)} particles in {interior.solid_voxels} solid voxels; "
        f"{found.pieces_before} pieces, {found.pieces_after} after bridging ({found.bridge_voxels} bridge voxels)."
    )
    if found.share_in_largest < 0.995 or interior.loose_particles:
        progress.warn(
            f"The object falls into {found.pieces_after} pieces and the largest holds {found.share_in_largest:.1%} of "
            f"it; small loose ones ({interior.loose_particles} particles) are not simulated but carried by what is "
            "nearest."
        )
    return interior


def settled_thickness(scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook) -> Continuum:
    """The continuum with the thickness that the user gave, else measured, else the material's usual one."""
    surfaces = {number: book.parts[name].surface for number, name in enumerate(parts.names)}
    usual = {number: surface.thickness_m for number, surface in surfaces.items() if surface.thickness_m is not None}
    settled = with_thickness(continuum, frame=asset.frame, given_m=_given_thickness(scene, parts), library_m=usual)
    return as_lumps(settled) if scene.interior.particles == "gaussians" else settled


def _given_thickness(scene: Scene, parts: Parts) -> dict[int, float]:
    """Thickness that the user gave, by part number: of sheets and rods, and of the wall of a vessel."""
    return {
        parts.names.index(name): options.thickness_m
        for name, options in options_by_part(scene, parts.names).items()
        if options.thickness_m is not None
    }


def _hollow_walls(scene: Scene, parts: Parts) -> dict[int, float]:
    """Wall thickness in metres of the hollow parts, by part number."""
    walls: dict[int, float] = {}
    for name, wall in scene.interior.hollow.items():
        if name not in parts.names:
            raise SceneError(
                f"interior.hollow: expected names of parts ({', '.join(parts.names)}), got '{name}'."
                f"{did_you_mean(name, parts.names)}"
            )
        if isinstance(wall, bool):
            if not wall:
                continue
            wall = _usual_wall(name, options_by_part(scene, parts.names).get(name))
        walls[parts.names.index(name)] = wall
    return walls


def _usual_wall(name: str, options: PartOptions | None) -> float:
    """Wall thickness of a part of which the scene only says that it is hollow, metres."""
    entry = find_entry(options.material) if options is not None and options.material is not None else None
    if options is not None and options.thickness_m is not None:
        return options.thickness_m
    if entry is not None and entry.thickness_m is not None:
        return entry.thickness_m.value
    raise SceneError(
        f"interior.hollow.{name}: expected a wall thickness, got true, and neither parts.{name}.thickness_m nor the "
        f"usual thickness of its material is known. Give the wall in metres: --interior.hollow.{name} 0.003"
    )
