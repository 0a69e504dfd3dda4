"""Several objects, each understood by itself, become one: placed in metres with z up, parts named ``object/part``.

Gaussians, parts, particles and materials of the objects follow each other in the order of the scene. A Gaussian's mean
x becomes s R U x + t, with U its object's rotation to z up, s its metres per unit, R the turn that the scene asks for
and t such that the middle of the underside of its robust box comes to lie at ``position_m``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.interior import Interior, joined_interiors
from phys4dgen.materials import read_materials
from phys4dgen.progress import Progress
from phys4dgen.render.sh_rotation import rotate_sh
from phys4dgen.scene import SEPARATOR, PlacedObject, Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.materials import as_told
from phys4dgen.stages.overlap import refuse_overlap
from phys4dgen.stages.reconstruct import Source
from phys4dgen.stages.resolution import COARSE_GRID, FINE_GRID, MOST_PARTICLES, estimated_particles
from phys4dgen.types import Continuum, Gaussians, MaterialBook, PartMaterials, Parts

__all__ = [
    "Pose",
    "ReadyObject",
    "join_books",
    "join_interiors",
    "join_parts",
    "pose_of",
    "put_together",
    "shared_cell_m",
]

_FEWEST_CELLS = 8
"""Along the longest side of an object that the grid still resolves."""


@dataclass(frozen=True, eq=False)
class ReadyObject:
    """One of several objects as it was understood by itself, as far as the run goes.

    Attributes:
        name: in the scene.
        asset: in its own input's coordinates.
        backend: what made its Gaussians.
        parts, interior, book: its own; None where the run ends before.
        products: digest by name of what its stages made.
        warnings: what its own run warned of.
    """

    name: str
    asset: Asset
    backend: str
    parts: Parts | None = None
    interior: Interior | None = None
    book: MaterialBook | None = None
    products: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Pose:
    """How an object's own coordinates stand in the scene: x_scene = scale * rotation @ x + shift_m.

    Attributes:
        turn: from the object's upright axes to the scene's, proper rotation, [3, 3].
        rotation: from its input's axes to the scene's, proper rotation, [3, 3].
        scale: metres per unit of its input.
        shift_m: [3].
    """

    turn: NDArray[np.float64]
    rotation: NDArray[np.float64]
    scale: float
    shift_m: NDArray[np.float64]

    def points(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Points [.., 3] of the object's input in the scene, metres."""
        return np.asarray(points, np.float64) @ (self.scale * self.rotation).T + self.shift_m

    def gaussians(self, gaussians: Gaussians) -> Gaussians:
        """The object's Gaussians in the scene: turned with their colours, moved, in metres."""
        turn = Rotation.from_matrix(self.rotation)
        own = Rotation.from_quat(gaussians.quats_wxyz.astype(np.float64), scalar_first=True)
        return Gaussians(
            means=self.points(gaussians.means).astype(np.float32),
            quats_wxyz=(turn * own).as_quat(scalar_first=True).astype(np.float32),
            scales=(gaussians.scales.astype(np.float64) * self.scale).astype(np.float32),
            opacities=gaussians.opacities,
            sh=rotate_sh(gaussians.sh, np.broadcast_to(self.rotation, (len(gaussians), 3, 3))),
        )


def pose_of(placed: PlacedObject, asset: Asset) -> Pose:
    """Where an object goes: it is turned, then put down at its place."""
    turn = Rotation.from_euler("xyz", placed.rotation_deg, degrees=True).as_matrix()
    rotation = turn @ asset.frame.rotation
    lower, upper = asset.gaussians.robust_bounds(rotation=rotation)
    scale = asset.frame.metres_per_unit
    foot = np.array([*(0.5 * (lower + upper))[:2], lower[2]]) * scale
    return Pose(turn, rotation, scale, np.array(placed.position_m) - foot)


def shared_cell_m(scene: Scene, assets: Mapping[str, Asset], progress: Progress) -> float:
    """Edge of a grid cell that serves all objects, metres.

    By itself so fine that the smallest has 64 cells along its longest side, or coarser where all together would take
    too many particles.
    """
    longest_m = {
        name: float((asset.upper - asset.lower).max()) * asset.frame.metres_per_unit for name, asset in assets.items()
    }
    largest_m = max(longest_m.values())
    asked = scene.simulation
    if asked.cell_m is not None:
        cell_m = asked.cell_m
    elif not isinstance(asked.grid, str):
        cell_m = largest_m / asked.grid
    else:
        cell_m = min(longest_m.values()) / FINE_GRID
        wanted = sum(
            estimated_particles(asset.gaussians, rotation=asset.frame.rotation, grid=FINE_GRID)
            * (longest_m[name] / (FINE_GRID * cell_m)) ** 3
            for name, asset in assets.items()
        )
        cell_m *= max(1.0, wanted / MOST_PARTICLES) ** (1 / 3)
        cell_m = min(cell_m, largest_m / COARSE_GRID)
    for name, length_m in longest_m.items():
        if length_m < _FEWEST_CELLS * cell_m:
            progress.warn(
                f"{name} is {length_m / cell_m:.1f} grid cells of {1e3 * cell_m:.3g} mm long, too few for its shape "
                f"and its contact; give a finer grid (--simulation.cell-m {length_m / (2 * _FEWEST_CELLS):.2g})."
            )
    return cell_m


def put_together(scene: Scene, objects: Sequence[ReadyObject], cell_m: float) -> Source:
    """All Gaussians in the scene's coordinates, metres with z up."""
    moved = [pose_of(scene.objects[own.name], own.asset).gaussians(own.asset.gaussians) for own in objects]
    most = max(gaussians.sh.shape[1] for gaussians in moved)
    return Source(
        Gaussians(
            means=np.concatenate([gaussians.means for gaussians in moved]),
            quats_wxyz=np.concatenate([gaussians.quats_wxyz for gaussians in moved]),
            scales=np.concatenate([gaussians.scales for gaussians in moved]),
            opacities=np.concatenate([gaussians.opacities for gaussians in moved]),
            sh=np.concatenate(
                [np.pad(gaussians.sh, ((0, 0), (0, most - gaussians.sh.shape[1]), (0, 0))) for gaussians in moved]
            ),
        ),
        "; ".join(f"{own.name}: {own.backend}" for own in objects),
        cell_m=cell_m,
    )


def join_parts(objects: Sequence[ReadyObject]) -> Parts:
    """Their parts as ``object/part``, in the order of the objects."""
    labels: list[NDArray[np.int32]] = []
    names: list[str] = []
    visible: list[NDArray[np.bool_] | None] = []
    backends: list[str] = []
    for own in objects:
        assert own.parts is not None
        labels.append(own.parts.labels + np.int32(len(names)))
        names += [f"{own.name}{SEPARATOR}{name}" for name in own.parts.names]
        visible.append(own.parts.visible)
        backends.append(own.parts.backend)
    seen = [array for array in visible if array is not None]
    return Parts(
        np.concatenate(labels),
        tuple(names),
        "; ".join(dict.fromkeys(backends)),
        visible=np.concatenate(seen) if len(seen) == len(visible) else None,
    )


def join_interiors(scene: Scene, objects: Sequence[ReadyObject], asset: Asset, progress: Progress) -> Interior:
    """Their particles in the scene's coordinates.

    Raises:
        SceneError: two objects overlap.
    """
    placed: dict[str, Interior] = {}
    part_count = gaussian_count = 0
    for own in objects:
        assert own.parts is not None and own.interior is not None
        continuum = _placed(own.interior.continuum, pose_of(scene.objects[own.name], own.asset))
        itself = continuum.gaussian_index
        continuum = replace(
            continuum,
            part=continuum.part + np.int32(part_count),
            gaussian_index=np.where(itself < 0, -1, itself + gaussian_count).astype(np.int32),
        )
        part_count, gaussian_count = part_count + own.parts.count, gaussian_count + len(own.asset.gaussians)
        placed[own.name] = replace(own.interior, continuum=continuum)
    joined = joined_interiors(list(placed.values()))
    refuse_overlap(
        {name: interior.continuum.positions for name, interior in placed.items()},
        scene.objects,
        spacing_m=joined.continuum.spacing_m,
        cell_m=asset.cell_m,
        progress=progress,
    )
    return joined


def _placed(continuum: Continuum, pose: Pose) -> Continuum:
    """Particles of an object in the scene; as the run folder keeps them, to the bit."""
    return replace(
        continuum,
        positions=pose.points(continuum.positions).astype(np.float32).astype(np.float64),
        offset_m=continuum.offset_m @ pose.turn.T,
    )


def join_books(scene: Scene, objects: Sequence[ReadyObject], parts: Parts, progress: Progress) -> MaterialBook:
    """Their materials under the names of the joined parts, and those of the scene's materials file in their place."""
    rows: dict[str, PartMaterials] = {}
    for own in objects:
        assert own.book is not None
        rows |= {f"{own.name}{SEPARATOR}{name}": materials for name, materials in own.book.parts.items()}
    if scene.materials.file is None:
        return MaterialBook(rows)
    in_file = read_materials(scene.materials.file, parts.names)
    told = as_told(scene, parts, MaterialBook(rows))
    for name in in_file:
        rows[name] = entry = told.parts[name]
        for warning in dict.fromkeys((*entry.surface.warnings, *entry.interior.warnings)):
            progress.warn(f"Material of part '{name}': {warning}.")
    return MaterialBook(rows)
