"""The Gaussians: read from a splat, or made from a picture or a mesh (paper: Sec. 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError
from phys4dgen.formats import load_gaussians
from phys4dgen.input_kinds import is_picture
from phys4dgen.progress import Progress
from phys4dgen.reconstruct.mesh.files import is_mesh
from phys4dgen.scene import Scene
from phys4dgen.stages.selection import Surroundings, surroundings_of
from phys4dgen.types import Camera, Gaussians

if TYPE_CHECKING:
    from phys4dgen.reconstruct.inflate import InflatedSolid

__all__ = ["Source", "reconstruct", "source_of_splat"]

_Y_UP = np.array([0.0, 1.0, 0.0])
"""Up in glTF, and of what is made of a picture."""


@dataclass(frozen=True, eq=False)
class Source:
    """The object as Gaussians, and what is known of it besides.

    Attributes:
        gaussians: of the input, or made from it.
        backend: what made them.
        up: which way is up, input coordinates, where the maker knows; else None.
        picture: the picture cut out and framed, straight sRGB and opacity, shape [S, S, 4]; None for a splat.
        camera: that sees the Gaussians as ``picture``.
        solid: exact inside test, where the maker knows it.
        even_colors: colours freed of the picture's light, shape [N, 3], where the maker knows them.
        surroundings: the scene that the Gaussians were selected from; None where they are the whole input.
        cell_m: grid cell of the simulation, where the Gaussians are several objects in metres, z up; else None.
    """

    gaussians: Gaussians
    backend: str
    up: NDArray[np.float64] | None = None
    picture: NDArray[np.float32] | None = None
    camera: Camera | None = None
    solid: InflatedSolid | None = None
    even_colors: NDArray[np.float32] | None = None
    surroundings: Surroundings | None = None
    cell_m: float | None = None


def reconstruct(scene: Scene, progress: Progress) -> Source:
    """Read the splat, or make one of the picture or the mesh.

    Raises:
        SceneError: part of something else than a splat is selected, or nothing.
    """
    path = scene.single_input
    if not scene.select.selects_all and (is_mesh(path) or is_picture(path)):
        raise SceneError(f"select: expected a captured splat to choose from, got '{path.name}'; remove select.")
    if is_mesh(path):
        return _from_mesh(scene)
    if not is_picture(path):
        return source_of_splat(scene)
    from phys4dgen.reconstruct.foreground import cut_out
    from phys4dgen.reconstruct.inflate import InflatedSolid, InflateOptions, inflate

    chosen = scene.reconstruct
    if _takes_lgm(scene, progress):
        return _by_lgm(scene, progress)
    cutout = cut_out(path, mask=chosen.mask, matte_model=chosen.matte_model)
    progress.note(f"The object was cut out of the picture by {cutout.source}.")
    if chosen.backend == "command":
        from phys4dgen.reconstruct.command import reconstruct_by_command

        by_program = reconstruct_by_command(
            cutout, chosen.argv, timeout_s=chosen.timeout_s, mesh_gaussians=chosen.mesh_gaussians
        )
        for warning in by_program.warnings:
            progress.warn(warning)
        up = _Y_UP if any("{out.glb}" in word for word in chosen.argv) else None
        return Source(by_program.gaussians, f"{by_program.backend}, object by {cutout.source}", up=up)
    options = InflateOptions(front_gaussians=chosen.front_gaussians, thickness=chosen.thickness_rel)
    made = inflate(cutout, options)
    for warning in made.warnings:
        progress.warn(warning)
    solid = made.solid if isinstance(made.solid, InflatedSolid) else None
    return Source(
        made.gaussians,
        f"{made.backend}, object by {cutout.source}",
        up=_Y_UP,
        picture=made.picture,
        camera=made.camera,
        solid=solid,
        even_colors=made.even_colors,
    )


def source_of_splat(scene: Scene) -> Source:
    """A splat as it lies there, or what the scene selects of it."""
    whole = load_gaussians(scene.single_input)
    surroundings = surroundings_of(scene, whole)
    if surroundings is None:
        return Source(whole, "splat as given")
    return Source(surroundings.object_gaussians, "selected from a splat", surroundings=surroundings)


def _from_mesh(scene: Scene) -> Source:
    """Gaussians in the surface of a mesh; glTF says that y is up, the other formats do not say."""
    from phys4dgen.reconstruct.mesh.gaussians import gaussians_from_mesh

    gaussians = gaussians_from_mesh(scene.single_input, count=scene.reconstruct.mesh_gaussians)
    up = _Y_UP if scene.single_input.suffix.lower() == ".glb" else None
    return Source(gaussians, "mesh, its surface sampled", up=up)


def _takes_lgm(scene: Scene, progress: Progress) -> bool:
    """Whether LGM is asked for, or ready where the choice is ours."""
    chosen = scene.reconstruct
    if chosen.backend != "auto" or chosen.checkpoint is None:
        return chosen.backend == "lgm"
    from phys4dgen.reconstruct.lgm.generator import torch_is_installed

    if not torch_is_installed():
        progress.warn(
            "A checkpoint of LGM is given, but torch is not installed, so the stand-in makes the object; "
            "pip install 'phys4dgen[models]'."
        )
    return torch_is_installed()


def _by_lgm(scene: Scene, progress: Progress) -> Source:
    """The object that LGM sees in four views; the input itself is not looked at."""
    from phys4dgen.reconstruct.lgm.configuration import BIG
    from phys4dgen.reconstruct.lgm.four_views import read_views
    from phys4dgen.reconstruct.lgm.generator import reconstruct_by_lgm

    chosen = scene.reconstruct
    assert chosen.checkpoint is not None  # the scene holds checkpoint and views together
    made = reconstruct_by_lgm(read_views(chosen.views, size_px=BIG.input_px), chosen.checkpoint)
    for warning in made.warnings:
        progress.warn(warning)
    return Source(made.gaussians, made.backend, up=_Y_UP, picture=made.picture, camera=made.camera)
