"""The object as it was given: which way is up and how large it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError
from phys4dgen.progress import Progress
from phys4dgen.reconstruct.reconstruction import Solid
from phys4dgen.scene import Scene
from phys4dgen.stages.reconstruct import Source
from phys4dgen.stages.resolution import FINE_GRID, MOST_PARTICLES, MOST_PARTICLES_OF_A_GUESS, automatic_grid
from phys4dgen.stages.selection import Surroundings
from phys4dgen.types import SH_C0, Camera, Frame, Gaussians, rotation_to_z_up
from phys4dgen.upright import guess_up

__all__ = ["Asset", "load"]

_MOST_CELLS = 512
"""As of ``simulation.grid``."""


@dataclass(frozen=True, eq=False)
class Asset:
    """The object and how it stands in the world.

    Attributes:
        gaussians: as in the input, its N and order, or those selected of it.
        frame: input coordinates -> metres, z up.
        lower, upper: robust box in upright axes, input units, [3].
        cell: grid cell dx of the simulation, input units.
        solid: exact inside test, where the object was made from a picture that gave one; else None.
        camera: of the picture that the object was made from, where it is known; else None.
        even_colors: colours of the Gaussians freed of the picture's light, where they are known; else None.
        surroundings: the scene that the Gaussians were selected from; None where they are the whole input.
    """

    gaussians: Gaussians
    frame: Frame
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    cell: float
    solid: Solid | None = None
    camera: Camera | None = None
    even_colors: NDArray[np.float32] | None = None
    surroundings: Surroundings | None = None

    @property
    def whole(self) -> Gaussians:
        """All Gaussians of the input."""
        return self.gaussians if self.surroundings is None else self.surroundings.whole

    @property
    def evenly_lit(self) -> Gaussians:
        """The Gaussians as light from everywhere would show them, as far as that is known: one material, one colour."""
        if self.even_colors is None:
            return self.gaussians
        return replace(self.gaussians, sh=((self.even_colors - 0.5) / SH_C0)[:, None])

    @property
    def grid(self) -> int:
        """Cells along the longest side."""
        return round(float((self.upper - self.lower).max()) / self.cell)

    @property
    def cell_m(self) -> float:
        """Grid cell dx, metres."""
        return self.cell * self.frame.metres_per_unit

    @property
    def height_m(self) -> float:
        """Robust extent along up, metres."""
        return float(self.upper[2] - self.lower[2]) * self.frame.metres_per_unit


def load(scene: Scene, source: Source, progress: Progress) -> Asset:
    """Decide which way is up and how large the object is; several together are in metres with z up already."""
    gaussians = source.gaussians
    if source.cell_m is not None:
        lower, upper = gaussians.robust_bounds()
        return Asset(gaussians, Frame(np.eye(3), 1.0), lower, upper, source.cell_m)
    if source.surroundings is not None:
        progress.note(f"{len(gaussians)} of {len(source.surroundings.whole)} Gaussians are the object; the rest rests.")
    rotation = rotation_to_z_up(_up_vector(scene, source, progress))
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    extent = upper - lower
    if not (extent > 0).all():
        raise SceneError(
            f"{scene.single_input}: expected an object with a volume, got an extent of {extent.tolist()} units."
        )
    paper = scene.paper_scale
    if paper is not None:
        metres_per_unit = 1 / extent.max()
    elif scene.longest_m is not None:
        metres_per_unit = scene.longest_m / extent.max()
    else:
        if scene.height_m == "auto":
            progress.warn("The real size is not known: the object is taken to be 0.3 m tall; give --height-m.")
        metres_per_unit = (0.3 if isinstance(scene.height_m, str) else scene.height_m) / extent[2]
    frame = Frame(rotation, float(metres_per_unit))
    grid = scene.simulation.grid
    if scene.simulation.cell_m is not None:
        grid = float(extent.max()) * frame.metres_per_unit / scene.simulation.cell_m
        if grid > _MOST_CELLS:
            raise SceneError(
                f"simulation.cell_m: {scene.simulation.cell_m:g} m would cut the object into {grid:.0f} cells along "
                f"its longest side, {_MOST_CELLS} at most are possible; give a larger cell."
            )
    elif isinstance(grid, str) and paper is not None:
        grid = paper.grid
    elif isinstance(grid, str):
        enough = MOST_PARTICLES if source.solid is None else MOST_PARTICLES_OF_A_GUESS
        grid = automatic_grid(gaussians, rotation=rotation, most_particles=enough)
        if grid < FINE_GRID:
            progress.note(f"Grid of {grid} cells: filled finer, so massive an object would take very long (--grid N).")
    return Asset(
        gaussians,
        frame,
        lower,
        upper,
        float(extent.max()) / grid,
        solid=source.solid,
        camera=source.camera,
        even_colors=source.even_colors,
        surroundings=source.surroundings,
    )


def _up_vector(scene: Scene, source: Source, progress: Progress) -> NDArray[np.float64]:
    if not isinstance(scene.up, str):
        return np.array(scene.up)
    if scene.up != "auto":
        axis = "xyz".index(scene.up[-1])
        return np.eye(3)[axis] * (-1.0 if scene.up.startswith("-") else 1.0)
    if source.up is not None:
        return source.up
    guess = guess_up(source.gaussians)
    if not guess.is_sure:
        progress.warn(f"Which way is up is a guess ({guess.reason}); give --up if the picture is on its side.")
    return guess.up
